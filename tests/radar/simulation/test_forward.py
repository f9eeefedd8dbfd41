"""The fast forward model on the paper's array against the exact one."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.radar.samples import relative_error

pytestmark = pytest.mark.usefixtures("planned")

TONES_HZ = np.linspace(72e9, 82e9, 16)
COUNT = 400
RANDOM = np.random.default_rng(5)
PLACES_M = RANDOM.uniform([-0.1, -0.1, 0.245], [0.1, 0.1, 0.325], (COUNT, 3))
NORMAL = RANDOM.normal([0, 0, -1], 0.5, (COUNT, 3))
NORMAL /= np.linalg.norm(NORMAL, axis=1)[:, None]
WHOLE = Scatterers(PLACES_M, RANDOM.uniform(size=COUNT), NORMAL, RANDOM.uniform(0, 1e-3, COUNT))
# A third is seen by all antennas, a third by those beyond some antenna of each leg, a third by few.
FIRST = np.array([[0] * COUNT, RANDOM.integers(0, 94, COUNT), RANDOM.integers(90, 100, COUNT)])
FIRST = FIRST[np.arange(COUNT) % 3, np.arange(COUNT)]
SEEN = tuple(np.arange(94)[:, None] >= start for start in (FIRST, FIRST[::-1]))


@pytest.mark.parametrize(
    ("changes", "pattern", "tolerance"),
    [
        ({}, 0.0, 1e-3),
        ({"seen": SEEN}, 0.0, 1e-5),
        ({"seen": SEEN}, 2.4, 1e-5),  # 60° wide at half power
        ({"seen": SEEN, "normal": None}, 40.0, 1e-5),  # 15°
    ],
)
def test_a_bumpy_sheet_that_is_partly_hidden_meets_the_tolerance(changes, pattern, tolerance):
    sheet = replace(WHOLE, **changes)
    fast, exact = (
        simulate(sheet, TONES_HZ, qar50(), tolerance=t, pattern=pattern) for t in (tolerance, None)
    )
    assert relative_error(fast, exact) < tolerance


def test_points_that_nothing_sees_echo_nothing():
    every = np.ones((94, COUNT), bool)
    for tolerance in (None, 1e-5):
        blind = replace(WHOLE, seen=(~every, every))
        assert not simulate(blind, TONES_HZ[:2], qar50(), tolerance=tolerance).any()
    # Where all antennas see everything, a mask changes nothing at all.
    masked, plain = (
        simulate(replace(WHOLE, seen=s), TONES_HZ[:2], qar50()) for s in ((every, every), None)
    )
    assert np.array_equal(masked, plain)
