"""The comparison with packages of others: they image what the direct sum does, and equal error is
read off a front."""

from functools import partial

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.support.errors import HandbenchError
from tests.bench.studies.engine.foreign_engines import (
    ENGINE,
    LEVELS,
    equal,
    measured,
    of_volume,
    seconds_at,
)
from tests.bench.studies.engine.foreign_paths import Contender, fastsar_sum, finufft_sum
from tests.bench.studies.engine.scope import white_noise
from tests.radar.direct_sums import direct_sum
from tests.radar.samples import relative_error

TONES_HZ = np.linspace(72e9, 82e9, 64)


# The NUFFT is made to its eps, which the rounding of single precision adds to. Profiles are
# interpolated linearly between 64 bins per cell: (π/64)²/8 = 3e-4 at the band's edges.
@pytest.mark.parametrize(
    ("package", "image", "error"),
    [
        ("finufft", partial(finufft_sum, eps=1e-5), 5e-5),
        ("finufft", partial(finufft_sum, eps=1e-5, upsampfac=1.25), 5e-5),
        ("fastsar", partial(fastsar_sum, upsample=64), 1e-3),
    ],
)
def test_packages_of_others_agree_with_the_direct_sum(package, image, error):
    """Against a sum written apart; an odd number of tones has another middle tone."""
    pytest.importorskip(package, reason=f"{package} is no requirement of handbench")
    array = AntennaArray(qar50().tx_m[::31], qar50().rx_m[::23])
    points = np.random.default_rng(0).uniform([-0.1, -0.1, 0.25], [0.1, 0.1, 0.32], (20, 3))
    for tones in (64, 63):
        samples = white_noise((tones, *array.channels))
        reference = direct_sum(samples, TONES_HZ[:tones], array, points)
        assert relative_error(image(samples, TONES_HZ[:tones], array, points), reference) < error


def test_equal_error_is_between_settings_that_nothing_beats():
    """A front written by hand: seconds grow as error^(−1/2); the third setting is beaten and does
    not count."""
    error, seconds = np.array([1e-1, 1e-3, 1e-2, 1e-5]), np.array([1.0, 10.0, 50.0, 100.0])
    assert seconds_at(1e-2, error, seconds) == pytest.approx(np.sqrt(10))
    assert seconds_at(1e-4, error, seconds) == pytest.approx(np.sqrt(1000))
    assert seconds_at(1.0, error, seconds) == 1.0  # the coarsest there is
    assert seconds_at(1e-5, error, seconds) == 100.0
    assert seconds_at(9e-6, error, seconds) is None


def test_paths_stand_beside_the_engine_or_do_not_reach_an_error():
    def row(path: str, error: float, seconds: float) -> dict:
        known = {"relative_error": error, "seconds": seconds, "points_per_second": 78141 / seconds}
        return {"volume": "61 × 61 × 21", "path": path, **known}

    rows = equal([row(ENGINE, 1e-2, 0.1), row(ENGINE, 1e-5, 0.2), row("other", 1e-3, 20.0)])
    found = {(r["level"], r["path"]): r for r in rows}
    assert len(found) == 2 * len(LEVELS)
    assert found["error 1e-2", "other"]["ratio_to_engine"] == pytest.approx(200)
    assert found["error 1e-3", "other"]["points_per_second"] == pytest.approx(78141 / 20)
    assert (
        not found["error 1e-4", "other"]["reached"]
        and "seconds" not in found["error 1e-4", "other"]
    )


def test_a_volume_is_extrapolated_from_its_part(monkeypatch):
    """Clocks by hand: 1 s for the samples and 2 s for a quarter of the voxels make 9 s."""
    took = iter([np.array([1.0, 1.0]), np.array([3.0, 5.0])])
    monkeypatch.setattr(
        "tests.bench.studies.engine.foreign_engines.clocked", lambda work: next(took)
    )
    nothing = Contender("", "", lambda voxels, samples: samples, lambda: None, 0.25, lambda: None)
    assert of_volume(nothing) == pytest.approx([9.0, 17.0])


def test_more_than_one_thread_is_refused(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with pytest.raises(HandbenchError, match=r"OMP_NUM_THREADS.*must be 1 before Python starts"):
        measured("61 × 61 × 21")
