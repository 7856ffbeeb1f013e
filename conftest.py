"""Settings of all tests, and fixtures that the core's and the plugins' share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Seeded, and never failing for a machine that is slow today.
settings.register_profile("vrbench", deadline=None, derandomize=True)
settings.load_profile("vrbench")


@pytest.fixture(scope="session", autouse=True)
def _no_reports(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Runs of tests copy no conformance reports that the user has, and keep none of theirs."""
    os.environ["VRBENCH_REPORTS"] = str(tmp_path_factory.mktemp("reports"))


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Tests neither see nor fill the cache that the user has."""
    os.environ["VRBENCH_CACHE"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session")
def shared() -> Path:
    """Real packets and exports of others, where they are at hand."""
    data = os.environ.get("VRBENCH_DATA")
    if not data:
        pytest.skip("VRBENCH_DATA isn't set: real packets and exports lie in `fixtures` beside it")
    folder = Path(data).parent / "fixtures"
    if not folder.is_dir():
        pytest.skip(f"no real packets and exports: {folder} isn't there")
    return folder
