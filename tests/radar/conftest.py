"""What tests of imaging share."""

from collections.abc import Iterator

import pytest

from tests.radar.samples import always_planned


@pytest.fixture(scope="module")
def planned() -> Iterator[None]:
    """`always_planned` for a whole file."""
    with always_planned():
        yield
