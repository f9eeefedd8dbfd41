"""One capture and what it becomes in MAROON's layout, for all tests of the adapters."""

import shutil
from pathlib import Path

import pytest

from tests.bench.datasets.foreign_captures import echoes, write_native
from tests.bench.datasets.maroon_writer import write_maroon


@pytest.fixture(scope="session")
def native(tmp_path_factory) -> Path:
    """A capture folder with two frames."""
    return write_native(tmp_path_factory.mktemp("captures") / "native", echoes())


@pytest.fixture(scope="session")
def maroon(native) -> Path:
    """The same as MAROON's patch/30, their x negated."""
    return write_maroon(native, native.parent / "maroon")


@pytest.fixture
def mine(maroon, tmp_path) -> Path:
    """A copy of the object, to spoil."""
    return shutil.copytree(maroon.parents[1], tmp_path / "maroon") / "patch" / "30"
