"""Settings of all tests, the core's and the plugins'."""

from __future__ import annotations

from hypothesis import settings

# Seeded, and never failing for a machine that is slow today.
settings.register_profile("vrbench", deadline=None, derandomize=True)
settings.load_profile("vrbench")
