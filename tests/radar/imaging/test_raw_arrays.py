"""Imaging functions given what no capture holds: the right image, or an error that names the
argument."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.support.errors import HandbenchError
from tests.radar.direct_sums import direct_echoes

pytestmark = pytest.mark.usefixtures("planned")

RANDOM = np.random.default_rng(0)
TX_M, RX_M = (RANDOM.uniform(-0.07, 0.07, (n, 3)) * [1, 1, 0] for n in (6, 5))
ARRAY = AntennaArray(TX_M, RX_M)
TONES_HZ = np.array([72e9, 82e9, 80e9])
POINTS_M = RANDOM.uniform(-0.03, 0.03, (40, 3)) + [0, 0, 0.3]
AXIS_M = np.linspace(-0.02, 0.02, 9)
GRID = VoxelGrid(AXIS_M, AXIS_M, AXIS_M + 0.3)


def echoes():
    return direct_echoes(np.array([[0.005, 0.002, 0.3]]), [1.0], TONES_HZ, ARRAY)


def images(samples):
    """Every imaging function's image."""
    for tolerance in (None, 1e-3):
        yield image_points(samples, TONES_HZ, ARRAY, POINTS_M, tolerance)
        yield image_points(samples, TONES_HZ, ARRAY, POINTS_M, tolerance, per_tone=True)
        yield image_volume(samples, TONES_HZ, ARRAY, GRID, tolerance)
        yield project_volume(samples, TONES_HZ, ARRAY, GRID, tolerance)[1]


def test_ordinary_samples_keep_their_type_and_zeros_are_zeros():
    assert {image.dtype for image in images(echoes())} == {np.dtype("c8"), np.dtype("f4")}
    assert not image_points(np.zeros_like(echoes()), TONES_HZ, ARRAY, POINTS_M, 1e-3).any()


def replaced(values, place, value):
    values = values.astype(np.result_type(values, np.min_scalar_type(value)))
    values[place] = value
    return values


@pytest.mark.parametrize(
    ("name", "wrong", "reason"),
    [
        ("samples", replaced(echoes(), (2, 5, 4), 1j * np.inf), "have NaN or infinite values"),
        ("samples", echoes().astype(object), "object"),
        ("samples", echoes()[:, :5], r"have shape \(3, 5, 5\); expected \(3, 6, 5\)"),
        ("samples", echoes() * 1e25, "expected 1e-20 to 1e"),
        ("samples", echoes() * 1e-25, "expected 1e-20 to 1e"),
        ("frequencies_hz", [72e9, np.nan, 80e9], ""),
        ("frequencies_hz", [72e9, 0.0, 80e9], ""),
        ("frequencies_hz", [72e9, 1e300, 80e9], ""),
        ("frequencies_hz", TONES_HZ.astype(complex), ""),
        ("frequencies_hz", [], ""),
        ("points_m", np.ones((40, 2)), ""),
        ("points_m", np.ones(()), ""),
    ],
)
def test_arguments_that_are_none_are_named(name, wrong, reason):
    right = {"samples": echoes(), "frequencies_hz": TONES_HZ, "points_m": POINTS_M} | {name: wrong}
    samples, tones_hz, points_m = right.values()
    works = [(image_points, points_m, t) for t in (None, 1e-3)]
    if name != "points_m":
        works += [(image, GRID, 1e-3) for image in (image_volume, project_volume)]
    for image, where, tolerance in works:
        with pytest.raises(HandbenchError, match=f"^{name}: .*{reason}"):
            image(samples, tones_hz, ARRAY, where, tolerance)


@pytest.mark.parametrize("scale", [1e300, 1e-300])
def test_samples_that_a_file_cannot_hold_are_refused(scale, tmp_path):
    capture = RadarCapture(echoes()[None] * scale, TONES_HZ, ARRAY)
    with pytest.raises(HandbenchError, match=r"^samples: the largest"):
        save_capture(tmp_path / "echoes.h5", capture)
    assert not (tmp_path / "echoes.h5").exists()
