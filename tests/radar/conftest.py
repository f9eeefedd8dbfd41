"""What tests of imaging share."""

from collections.abc import Iterator
from unittest.mock import patch

import pytest

from radar.imaging.plan import TreePlan


@pytest.fixture(scope="module")
def planned() -> Iterator[None]:
    """Images of points are made by plans, few as they are: a test's points are so few that their exact sum costs less,
    which would then be compared with itself."""
    with patch.object(TreePlan, "cost", lambda *_: 0.0):
        yield
