"""The engine's benchmark: its yardsticks are right, and its bars say what was measured."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from tests.bench.studies.engine.checks import bars, exponent, finer, larger, resampled
from tests.bench.studies.engine.scope import Inputs, Scope, white_noise
from tests.bench.studies.engine.textbook import numba_sum, numpy_sum, range_compressed
from tests.radar.direct_sums import direct_sum
from tests.radar.samples import relative_error

TONES_HZ = np.linspace(72e9, 82e9, 64)


# Range profiles are interpolated linearly between 64 bins per cell: (π/64)²/8 = 3e-4 at the band's
# edges.
@pytest.mark.parametrize(
    ("image", "error"), [(numpy_sum, 1e-12), (numba_sum, 1e-12), (range_compressed, 1e-3)]
)
def test_yardsticks_agree_with_the_direct_sum(image, error):
    array = AntennaArray(qar50().tx_m[::31], qar50().rx_m[::31])
    samples = white_noise((64, *array.channels))
    points = np.random.default_rng(0).uniform([-0.1, -0.1, 0.25], [0.1, 0.1, 0.32], (20, 3))
    reference = direct_sum(samples, TONES_HZ, array, points)
    assert relative_error(image(samples, TONES_HZ, array, points), reference) < error


def test_paths_beyond_the_ambiguity_are_refused():
    array, few_hz = AntennaArray(qar50().tx_m[:2], qar50().rx_m[:2]), np.linspace(72e9, 82e9, 16)
    with pytest.raises(ValueError, match=r"unambiguous to 0\.45 m"):
        range_compressed(white_noise((16, 2, 2)), few_hz, array, np.array([[0.0, 0.0, 0.3]]))


def test_growth_is_the_slope_of_the_logarithms():
    assert exponent([1, 2, 4, 8], [3.0, 6.0, 12.0, 24.0]) == pytest.approx(1.0)
    assert exponent([1, 10, 100], [5.0, 5.0, 5.0]) == pytest.approx(0.0, abs=1e-12)


def test_grown_grids_have_the_voxels_they_promise():
    grid = Inputs(Scope()).grid
    for factor in (2, 16):
        fine, wide = finer(grid, factor), larger(grid, factor)
        assert np.prod(fine.shape) == pytest.approx(factor * np.prod(grid.shape), rel=0.02)
        assert np.prod(wide.shape) == pytest.approx(factor * np.prod(grid.shape), rel=0.02)
        assert fine.z_m[[0, -1]] == pytest.approx(grid.z_m[[0, -1]])
        assert np.diff(wide.x_m)[0] == pytest.approx(np.diff(grid.x_m)[0])
    assert resampled(qar50(), 94).tx_m == pytest.approx(qar50().tx_m)
    assert resampled(qar50(), 24).channels == (24, 24)


def records(ratio: float, met: bool, compile_s: float) -> list[dict]:
    fast = {
        "depth_deviation_mm": 0.002,
        "mask_difference_px": 0,
        "met": met,
        "ratio_to_exact": ratio,
    }
    return [
        {"section": "volume", "method": "exact", "seconds": 400.0, "share_of_gemm": 0.7},
        {"section": "volume", "method": "fast projection, 1e-3", "seconds": 400 / ratio, **fast},
        {"section": "growth", "what": "voxels, finer steps", "exponent": 0.6},
        {"section": "growth", "what": "tones", "exponent": 3.0},
        {"section": "compilation", "what": "all kernels", "seconds": compile_s},
    ]


def test_a_bar_is_missed_when_its_figure_is():
    kept = bars(records(2000.0, True, 20.0))
    missed = bars(records(1000.0, False, 40.0))
    assert len(kept) == len(missed) == 7
    assert all(bar["met"] for bar in kept)
    unmet = [bar["bar"] for bar in missed if not bar["met"]]
    assert unmet == [
        "rows within their tolerance",
        "volume, fast projection, 1e-3: ratio_to_exact",
        "seconds to compile all kernels",
    ]
