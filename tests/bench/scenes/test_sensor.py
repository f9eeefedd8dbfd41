"""The sensor: exposure and white balance per photograph, clipping, draws of their own."""

from __future__ import annotations

import numpy as np
import pytest

from bench.scenes.photographs import EXPOSURE, WHITE_BALANCE, develop, exposure, generator, white_balance
from bench.scenes.scene_file import Photos

QUIET = {"full_well_e": 1e12, "read_noise_e": 0.0}


def linear(image: np.ndarray) -> np.ndarray:
    value = image / 255
    return np.where(value < 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def test_an_exposure_scales_the_light() -> None:
    radiance = np.broadcast_to(np.linspace(0.05, 0.3, 40, dtype=np.float32)[None, :, None], (2, 40, 3))
    for number in range(3):
        image = linear(develop(radiance, Photos(exposure_spread=0.5, **QUIET), 7, number))
        gain = exposure(0.5, generator(7, EXPOSURE, number))
        assert image == pytest.approx(gain * radiance, rel=0.03)


def test_spreads_are_standard_deviations_in_stops() -> None:
    stops = [np.log2(exposure(0.3, generator(1, EXPOSURE, number))) for number in range(2000)]
    assert np.std(stops) == pytest.approx(0.3, rel=0.05) and abs(np.mean(stops)) < 0.03
    gains = np.log2([white_balance(0.2, generator(1, WHITE_BALANCE, number)) for number in range(2000)])
    assert np.std(gains[:, [0, 2]] - gains[:, 1:2], axis=0) == pytest.approx([0.2, 0.2], rel=0.06)
    assert exposure(0.0, generator(1, EXPOSURE, 0)) == 1


def test_what_is_clipped_is_white() -> None:
    image = develop(np.full((2, 2, 3), 5.0, np.float32), Photos(white_balance_spread=0.5), 3, 0)
    assert (image == 255).all()
    assert white_balance(0.5, generator(3, WHITE_BALANCE, 0)).min() == 1


def test_noise_does_not_depend_on_the_exposure() -> None:
    dark, noisy = np.zeros((20, 20, 3), np.float32), {"full_well_e": 100.0, "read_noise_e": 20.0}
    plain = develop(dark, Photos(**noisy), 3, 1)
    assert plain.std() > 10
    assert np.array_equal(develop(dark, Photos(exposure_spread=1.0, **noisy), 3, 1), plain)
