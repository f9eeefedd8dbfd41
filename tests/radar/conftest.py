"""What tests of imaging share."""

from collections.abc import Iterator
from unittest.mock import patch

import pytest

from handbench.radar.imaging.plan import SortedPoints, TreePlan, fresh_plans


@pytest.fixture(scope="module")
def planned() -> Iterator[None]:
    """Images of points are made by plans, few as they are: a test's points are so few that their
    exact sum costs less, which would then be compared with itself. Whether a grid is planned stays
    as it is."""
    of_all = TreePlan.cost

    def cost(plan: TreePlan, where: SortedPoints | None = None) -> float:
        return of_all(plan) if where is None else 0.0

    with (
        fresh_plans(),
        patch.object(TreePlan, "cost", cost),
        patch("handbench.radar.imaging.api.node_cost", lambda _: 0.0),
    ):
        yield
