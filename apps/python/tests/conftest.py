"""What the tests have in common."""

import os
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def program() -> str:
    """The program, built from the same sources: ``PIGTAIL``, or the release in the clone."""
    named = os.environ.get("PIGTAIL") or str(ROOT / "target" / "release" / "pigtail")
    found = shutil.which(named)
    if found is None:
        pytest.skip(f"{named} is not built")
    return found
