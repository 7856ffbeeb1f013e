"""What the tests of live rigs share: a lab of emulated devices."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.live.lab import Lab

for name in ("vrbench_ur", "vrbench_optitrack", "vrbench_webxr"):
    pytest.importorskip(name)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    made = Lab(tmp_path_factory.mktemp("lab"))
    yield made
    made.close()


@pytest.fixture(scope="session")
def record_of():
    """What a run's record says."""
    return lambda run: json.loads((run / "run.json").read_text())


@pytest.fixture
def rng(request):
    """Chance, the same every time, and another for each test."""
    return np.random.default_rng([ord(c) for c in request.node.name])
