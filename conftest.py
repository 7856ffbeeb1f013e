"""What tests of the core and of all plugins share."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared() -> Path:
    """Real recordings and packets of others, where they are at hand."""
    data = os.environ.get("VRBENCH_DATA")
    if not data:
        pytest.skip("VRBENCH_DATA isn't set: real packets and exports lie in `fixtures` beside it")
    folder = Path(data).parent / "fixtures"
    if not folder.is_dir():
        pytest.skip(f"no real packets and exports: {folder} isn't there")
    return folder
