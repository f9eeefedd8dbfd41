"""Hard maps for the averaging filter: holes, borders, lone pixels, long rows, and weights that
differ without end.

Against direct sums in balls, within 2k + 10 roundings of 2⁻⁵³ each: k products and k sums along
each axis at most, the offset and the quotient. Each window is summed by itself and weights are
positive, so that no rounding of a strong pixel reaches a window without it.
"""

import numpy as np
import pytest

from handbench.radar.methods.pixels import masked_mean
from tests.references.balls import U, balls, off


def direct(values, size_px, weight):
    """The filter by its definition at the pixels [n] that are known."""
    known, half = np.isfinite(values), size_px // 2
    weight = balls(np.where(known, weight, 0))
    sums = []
    for part in (weight * balls(np.where(known, values, 0)), weight):
        for _ in range(2):
            padded = np.pad(part, [(half, half), (0, 0)])
            part = np.sum([padded[at : at + len(part)] for at in range(size_px)], axis=0).T
        sums.append(part[known])
    return sums[0] / sums[1]


@pytest.fixture
def averaged(within):
    """Assert that the averages of a map have its holes and are as near as their roundings allow."""

    def check(values, size_px, weight=None, place=""):
        known, average = np.isfinite(values), masked_mean(values, size_px, weight)
        np.testing.assert_array_equal(np.isfinite(average), known)
        if known.any():
            weight = np.ones(values.shape) if weight is None else weight
            error = off(average[known], direct(values, size_px, weight)).max()
            bound = (2 * size_px + 10) * U * np.abs(values[known]).max()
            within(error / bound, 1, "of the roundings", place)

    return check


def bumpy(seed, holes):
    generator = np.random.default_rng(seed)
    values = 0.3 + 0.02 * generator.standard_normal((37, 41))
    values[generator.random(values.shape) < holes] = np.nan
    return values


@pytest.mark.parametrize("holes", [0.0, 0.2, 0.9, 0.99])
@pytest.mark.parametrize("size_px", [1, 3, 5, 9, 31])
def test_averages_at_borders_holes_and_infinities(size_px, holes, averaged):
    values = bumpy(size_px, holes)
    values[3, 4], values[20, 20], values[0, 0] = np.inf, -np.inf, np.inf  # holes, too
    weight = np.random.default_rng(size_px).random(values.shape) + 0.1
    averaged(values, size_px)
    averaged(values, size_px, weight, "weighted")


def test_averages_along_a_million_samples_do_not_drift(within):
    """A running sum would keep the roundings of the first half, which is 1000 m higher. At 2500
    places: borders, the jump, and where a sum in double is furthest off."""
    size_px, count = 5, 1_000_000
    row = 0.3 + 0.02 * np.random.default_rng(0).standard_normal(count)
    row[: count // 2] += 1e3
    average = masked_mean(row[None], size_px)[0]
    rough = np.abs(average[2:-2] - np.convolve(row, np.ones(size_px) / size_px, "valid"))
    jump = count // 2 + np.arange(-500, 500)
    chosen = 2 + np.unique(np.r_[np.argpartition(rough, -1000)[-1000:], :500, jump])
    exact = sum(balls(row[chosen + shift]) for shift in range(-2, 3)) / size_px
    bound = (2 * size_px + 10) * U * 1e3
    within(off(average[chosen], exact).max() / bound, 1, "of the roundings")


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 1), (5, 5)], ids=str)
@pytest.mark.parametrize("value", [0.28, np.nan, np.inf, -np.inf])
def test_a_map_of_one_value_keeps_it(value, shape, averaged):
    averaged(np.full(shape, value), 5)


@pytest.mark.parametrize("size_px", [3, 5, 9])
@pytest.mark.parametrize("decades", [1, 6, 12, 16, 20, 40, 80, 166, 280])
def test_a_strong_pixel_beside_weak_ones_reaches_its_own_windows_alone(decades, size_px, averaged):
    """The powers of float32 images span 166 decades."""
    weight = np.full((37, 41), 10.0**-decades)
    weight[::11, ::13] = 1.0
    averaged(bumpy(decades, 0.1), size_px, weight)
