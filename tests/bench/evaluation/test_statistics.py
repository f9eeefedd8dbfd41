"""Intervals: they contain the estimate, cover what they promise, and widen where pixels err together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bench.evaluation.depth_errors import error_map
from bench.evaluation.metrics import RATIOS, TERMS, figures, pool
from bench.evaluation.statistics.intervals import (
    CAPTURES_AS_UNITS,
    _interval,
    contributions,
    cut,
    median_interval,
    note,
    pooled_intervals,
    precision_interval,
    spread,
    units_of,
)
from bench.results.error_map import ErrorMap
from tests.strategies import examples

PIXEL_M, PIXELS = 2.5e-3, 36  # 6 × 6 blocks of 6 × 6 pixels
HALF_NORMAL = np.sqrt(2 / np.pi)
ROWS, COLUMNS = np.mgrid[:PIXELS, :PIXELS]
HAND = ((COLUMNS - 17.5) / 10.8) ** 2 + ((ROWS - 19.5) / 17.3) ** 2 < 1  # 37 cm²: what a radar sees of a hand
NUMBER = np.where(HAND, ROWS // 6 * 6 + COLUMNS // 6, -1)
BLOCKS = np.unique(NUMBER[HAND])


def correlated(rng: np.random.Generator, shape: tuple[int, ...], length_m: float) -> np.ndarray:
    """Normal errors of unit variance [*shape, PIXELS, PIXELS] with the correlation exp(−r²/(2·length²)): white noise
    under a Gaussian of deviation length/√2, in the frequency domain, on a plane that is wider by 30 mm, for it closes
    in itself."""
    n = PIXELS + 12
    white = np.fft.rfft2(rng.standard_normal((*shape, n, n), dtype=np.float32))
    along_y, along_x = np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)
    gain = np.exp(-((np.pi * length_m / PIXEL_M) ** 2) * (along_y**2 + along_x**2))
    full = np.exp(-((np.pi * length_m / PIXEL_M) ** 2) * (along_y**2 + np.fft.fftfreq(n) ** 2))
    return np.fft.irfft2(white * gain, s=(n, n))[..., :PIXELS, :PIXELS] / np.sqrt((full**2).mean())


def block_sums(values: np.ndarray) -> np.ndarray:
    """Sums [..., block] over the blocks of values [..., PIXELS, PIXELS]."""
    return np.stack([values[..., block == NUMBER].sum(axis=-1) for block in BLOCKS], axis=-1)


def coverage(captures: int, length_m: float, differ: float, trials: int = 500) -> float:
    """Share of seeded trials in which the 95 % interval of the MAE holds the true MAE. differ: standard deviation of
    the captures' own (log) scale of error. The intervals are those of `pooled_intervals`, from sums over blocks."""
    rng = np.random.default_rng(2024)
    place = np.array([(c, block // 6, block % 6) for c in range(captures) for block in BLOCKS])
    units, pixels = units_of(place), np.tile(block_sums(HAND.astype(float)), captures)
    sums = dict.fromkeys(TERMS, np.zeros(len(place))) | {"observed": pixels, "surface": pixels}
    hits = 0
    for _ in range(trials):
        scale = np.exp(differ * rng.standard_normal((captures, 1, 1)) - differ**2 / 2)
        sums["absolute_m"] = 1e-3 * block_sums(np.abs(correlated(rng, (captures,), length_m)) * scale).ravel()
        found = spread(contributions(units, sums)["mae_mm"], units.weights)
        value = float(figures({name: values.sum() for name, values in sums.items()})["mae_mm"])
        low, high = _interval("mae_mm", value, found.reach())
        hits += low <= HALF_NORMAL <= high
    return hits / trials


@pytest.mark.parametrize(
    ("captures", "length_m", "differ"),
    [(3, 2e-3, 0.0), (3, 4e-3, 0.0), (20, 4e-3, 0.0), (20, 2e-3, 0.3), (5, 3e-3, 0.3)],
)
def test_intervals_cover_what_they_promise(captures, length_m, differ):
    """92 to 98 %, for errors that hang together over 5 mm (the paper's resolution, length 2 mm) to 9 mm, few captures
    and many, alike and not. 500 trials know a share of 95 % to 1 %."""
    assert 0.92 <= coverage(captures, length_m, differ) <= 0.98


def test_the_measured_intervals_are_the_ones_that_are_given():
    """The way by block sums that `coverage` takes ends where `pooled_intervals` does."""
    rng, axis_m = np.random.default_rng(0), PIXEL_M * np.arange(PIXELS)
    reference_m = np.where(HAND, 0.3, np.nan)
    maps = [error_map(axis_m, axis_m, 0.3 + 1e-3 * z, reference_m) for z in correlated(rng, (3,), 3e-3)]
    place = np.array([(c, block // 6, block % 6) for c in range(3) for block in BLOCKS])
    blocks = cut(maps)
    assert np.array_equal(blocks.place, place)
    np.testing.assert_allclose(
        blocks.sums["absolute_m"], np.concatenate([block_sums(np.abs(m.error_m)) for m in maps]), rtol=1e-12
    )
    units = units_of(place)
    reach = spread(contributions(units, blocks.sums)["mae_mm"], units.weights).reach()
    assert pooled_intervals(maps)["mae_mm"] == pytest.approx(_interval("mae_mm", pool(maps)["mae_mm"], reach), rel=1e-9)


def test_the_fields_hang_together_as_they_should():
    """Correlation e^(−1/2) at the length, e^(−2) at twice it; 200 fields know it to about 2 %."""
    z = correlated(np.random.default_rng(0), (200,), 2 * PIXEL_M)
    assert z.var() == pytest.approx(1, abs=0.05)
    for shift, expected in ((2, np.exp(-0.5)), (4, np.exp(-2))):
        assert np.mean(z[..., shift:] * z[..., :-shift]) == pytest.approx(expected, abs=0.05)


def noise_map(rng: np.random.Generator, n: int = 40, deviation_m: float = 1e-3, bias_m: float = 0) -> ErrorMap:
    """Independent normal errors on an n × n grid of 2.5 mm, an eighth of the pixels unobserved."""
    axis = 2.5e-3 * np.arange(n)
    reference_m = np.full((n, n), 0.3)
    z_m = reference_m + bias_m + deviation_m * rng.normal(size=(n, n))
    z_m[rng.random((n, n)) < 0.125] = np.nan
    return error_map(axis, axis, z_m, reference_m)


@given(st.integers(0, 10**6), st.integers(1, 6), st.floats(-2e-3, 2e-3))
@examples(25)
def test_contains_the_estimate(seed, captures, bias_m):
    rng = np.random.default_rng(seed)
    maps = [noise_map(rng, n=14, bias_m=bias_m) for _ in range(captures)]
    estimate, intervals = pool(maps), pooled_intervals(maps)
    known = {key for key in estimate if estimate[key] is not None} - {"n_observed"}
    assert set(intervals) == known and len(known) == 9
    assert all(low <= estimate[key] <= high for key, (low, high) in intervals.items())


def test_block_sums_give_the_pixels_figures():
    """Sums over blocks and over pixels must give the same figures (rounding only)."""
    maps = [noise_map(np.random.default_rng(seed)) for seed in range(3)]
    from_blocks = figures({name: values.sum() for name, values in cut(maps).sums.items()})
    estimate = pool(maps)
    for key in RATIOS:
        assert (estimate[key] is None) == (not np.isfinite(from_blocks[key]))
        assert estimate[key] is None or from_blocks[key] == pytest.approx(estimate[key], rel=1e-12)


def test_a_mean_of_equal_captures_has_students_interval():
    """Five captures of one pixel size: the textbook's mean ± t s/√5, on the scale of the logarithm."""
    errors_mm = np.array([1.0, 1.2, 0.9, 1.4, 1.1])
    axis_m = 2.5e-3 * np.arange(6)
    maps = [error_map(axis_m, axis_m, np.full((6, 6), 0.3 + 1e-3 * e), np.full((6, 6), 0.3)) for e in errors_mm]
    reach = stats.t.ppf(0.975, 4) * errors_mm.std(ddof=1) / np.sqrt(5)
    mean = errors_mm.mean()
    got = pooled_intervals(maps)
    assert got["mae_mm"] == pytest.approx((mean / np.exp(reach / mean), mean * np.exp(reach / mean)), rel=1e-9)
    assert got["bias_mm"] == pytest.approx((mean - reach, mean + reach), rel=1e-9)


def test_independent_blocks_of_one_size_have_students_variance():
    """W = 1: d·d·n/(n − 1) with n − 1 degrees of freedom, for d that are as even as can be."""
    d = np.tile([1.0, -1.0], 10)
    found = spread(d, np.eye(20))
    assert found.error == pytest.approx(np.sqrt(20 * 20 / 19), rel=1e-12) and found.freedom == pytest.approx(19)
    one_rules = spread(np.r_[10.0, np.full(19, -10 / 19)], np.eye(20))
    assert one_rules.freedom < 4  # (Σd²)²/(Σd⁴/3) = 3.3


def test_neighbours_that_err_together_are_believed_and_those_that_err_apart_are_not():
    together, apart = np.repeat([1.0, -1.0], 6), np.tile([1.0, -1.0], 6)
    weights = units_of(np.array([(0, 0, column) for column in range(12)])).weights
    assert weights[0, :4] == pytest.approx([1, 2 / 3, 1 / 3, 0])
    independent = spread(together, np.eye(12)).error
    assert spread(together, weights).error > 1.3 * independent
    assert spread(apart, weights).error == pytest.approx(independent)


def test_blocks_of_different_captures_do_not_err_together():
    place = np.array([(capture, 0, 0) for capture in range(3)])
    assert np.array_equal(units_of(place).weights, np.eye(3))


def test_maps_on_different_grids_share_their_blocks():
    """Half a hand's width apart, the same place is in the same block."""
    wide, narrow = (
        error_map(axis, axis, np.full((len(axis), len(axis)), 0.3), np.full((len(axis), len(axis)), 0.3))
        for axis in (np.arange(-0.045, 0.0449, 2.5e-3), np.arange(-0.0225, 0.0224, 2.5e-3))
    )
    assert {tuple(p) for p in cut([narrow]).place} < {tuple(p) for p in cut([wide]).place}


def test_too_few_captures_are_said():
    assert note(3).startswith("3 captures: the intervals speak of these captures, not of others")
    assert note(1).startswith("1 capture:") and "not of others" in note(1)
    assert "not of others" not in note(CAPTURES_AS_UNITS)


def test_pixels_that_err_together_widen_the_interval():
    """Errors equal within 15 mm carry 36 times less information than pixels: about 6 times the width, and somewhat less
    as the weights see pixels' neighbours."""
    rng = np.random.default_rng(0)
    axis = 2.5e-3 * np.arange(36)
    error_m = np.kron(1e-3 * rng.normal(size=(6, 6)), np.ones((6, 6)))
    maps = [ErrorMap(axis, axis, error_m, np.full_like(error_m, 0.3))]
    widths = [np.diff(pooled_intervals(maps, block_m=b)["bias_mm"])[0] for b in (0.015, 2.5e-3)]
    assert 2 < widths[0] / widths[1] < 9


def test_five_captures_are_units():
    """Captures that differ by their bias: five tell how captures differ, four only how their blocks do."""
    rng = np.random.default_rng(0)
    maps = [noise_map(rng, bias_m=bias_m) for bias_m in (-2e-3, -1e-3, 0, 1e-3, 2e-3)]
    five, four = (np.diff(pooled_intervals(m)["bias_mm"])[0] for m in (maps, maps[:4]))
    assert five > 3 * four


def test_a_maximum_ends_at_the_largest_error():
    maps = [noise_map(np.random.default_rng(0))]
    assert pooled_intervals(maps)["max_mm"].high == pool(maps)["max_mm"]


def test_no_interval_from_nothing():
    nothing = np.full((20, 20), np.nan)
    axis = 2.5e-3 * np.arange(20)
    assert pooled_intervals([]) == {}
    assert pooled_intervals([ErrorMap(axis, axis, nothing, nothing)]) == {}
    assert pooled_intervals([ErrorMap(axis, axis, nothing, np.full((20, 20), 0.3))]) == {}
    assert pooled_intervals([noise_map(np.random.default_rng(0), n=4)]) == {}  # one block


def test_one_observed_block_tells_no_interval():
    """Four blocks, one of them observed: nothing shows how blocks differ, but for the share that is observed."""
    axis = 2.5e-3 * np.arange(12)
    error_m = np.full((12, 12), np.nan)
    error_m[:6, :6] = 1e-3
    intervals = pooled_intervals([ErrorMap(axis, axis, error_m, np.full((12, 12), 0.3))])
    assert set(intervals) == {"completeness_percent"}


def test_a_share_of_all_is_not_certain():
    """Everything observed in all blocks: no spread is seen, and none is claimed to be zero."""
    axis = 2.5e-3 * np.arange(24)
    intervals = pooled_intervals([ErrorMap(axis, axis, np.full((24, 24), 1e-3), np.full((24, 24), 0.3))])
    assert "completeness_percent" not in intervals and intervals["mae_mm"] == pytest.approx((1, 1), rel=1e-9)


def test_one_hands_precision_has_the_textbook_interval():
    z_m = 0.3 + 1e-3 * np.random.default_rng(0).normal(size=10)
    s_mm = 1e3 * np.std(z_m, ddof=1)
    expected = [s_mm * np.sqrt(9 / stats.chi2.ppf(p, 9)) for p in (0.975, 0.025)]
    assert precision_interval([z_m]) == pytest.approx(expected, rel=1e-9)


def test_precision_interval_covers_three_unequal_hands():
    """Ten repeats of hands with deviations of 0.2, 0.3 and 0.4 mm: 95 % ± 3 standard errors of 1000 trials, and
    2 % for the approximation."""
    rng, sigma_mm = np.random.default_rng(1), np.array([0.2, 0.3, 0.4])
    hits = 0
    for _ in range(1000):
        low, high = precision_interval(list(0.3 + 1e-3 * sigma_mm[:, None] * rng.normal(size=(3, 10))))
        hits += low <= sigma_mm.mean() <= high
    assert 0.91 <= hits / 1000 <= 0.99


def test_precision_interval_of_nothing_and_of_no_scatter():
    assert precision_interval([]) is None
    assert precision_interval([np.array([0.3, np.nan])]) is None
    assert precision_interval([np.full(10, 0.25)]) == (0, 0)


def test_median_interval():
    values = np.random.default_rng(0).normal(5, 1, 100)
    low, high = median_interval(values)
    assert low < np.median(values) < high
    assert high - low < 1  # the median of 100 has a standard error of 0.125
    assert median_interval(values[:2]) is None
