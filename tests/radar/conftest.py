"""What tests of imaging share."""

import sys
from collections.abc import Iterator

import pytest

from tests.radar.imaging.cupy_stand_in import cupy_stand_in, has_gpu
from tests.radar.samples import always_planned


@pytest.fixture(scope="module")
def planned() -> Iterator[None]:
    """`always_planned` for a whole file."""
    with always_planned():
        yield


@pytest.fixture
def device(monkeypatch) -> str:
    """A device to image on: CUDA's, or where there is none, its stand-in."""
    if not has_gpu():
        monkeypatch.setitem(sys.modules, "cupy", cupy_stand_in())
    return "cuda"
