"""Imaging functions given what no capture holds: the right image, or an error that names the
argument."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from tests.radar.direct_sums import direct_echoes
from tests.refusals import refuse

pytestmark = pytest.mark.usefixtures("planned")

RANDOM = np.random.default_rng(0)
TX_M, RX_M = (RANDOM.uniform(-0.07, 0.07, (n, 3)) * [1, 1, 0] for n in (6, 5))
ARRAY = AntennaArray(TX_M, RX_M)
TONES_HZ = np.array([72e9, 82e9, 80e9])
POINTS_M = RANDOM.uniform(-0.03, 0.03, (40, 3)) + [0, 0, 0.3]
AXIS_M = np.linspace(-0.02, 0.02, 9)
GRID = VoxelGrid(AXIS_M, AXIS_M, AXIS_M + 0.3)
ECHOES = direct_echoes(np.array([[0.005, 0.002, 0.3]]), np.ones(1), TONES_HZ, ARRAY)
FUNCTIONS = ((image_points, POINTS_M), (image_volume, GRID), (project_volume, GRID))


@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_images_are_of_single_precision_and_zeros_are_zeros(tolerance):
    for image, where in FUNCTIONS:
        made = image(ECHOES, TONES_HZ, ARRAY, where, tolerance)
        kind = np.float32 if image is project_volume else np.complex64
        assert (made[1] if image is project_volume else made).dtype == kind
    assert not image_points(0 * ECHOES, TONES_HZ, ARRAY, POINTS_M, tolerance).any()
    none = image_points(ECHOES, TONES_HZ, ARRAY, POINTS_M[:0], tolerance, per_tone=True)
    assert none.shape == (3, 0)


@pytest.mark.parametrize(
    ("name", "wrong", "place"),
    [
        ("samples", np.where(ECHOES[2, 5, 4] == ECHOES, 1j * np.inf, ECHOES), "infinite"),
        ("samples", ECHOES.astype(object), "object"),
        ("samples", ECHOES[:, :5], "(3, 5, 5)"),
        ("samples", ECHOES * 1e25, "1e+20"),
        ("samples", ECHOES * 1e-25, "1e-20"),
        ("frequencies_hz", [72e9, np.nan, 80e9], "nan"),
        ("frequencies_hz", [72e9, 0.0, 80e9], "0.0"),
        ("frequencies_hz", [72e9, 1e300, 80e9], "1e+300"),
        ("frequencies_hz", TONES_HZ.astype(complex), "complex"),
        ("frequencies_hz", [], "(0,)"),
        ("tolerance", 1e-9, "1e-09"),
        ("tolerance", 0.5, "0.1"),
        ("tolerance", np.nan, "nan"),
    ],
)
def test_wrong_arguments_are_named(name, wrong, place):
    right = {"samples": ECHOES, "frequencies_hz": TONES_HZ, "aperture": ARRAY, "tolerance": 1e-3}
    for image, where in FUNCTIONS:
        places = {"points_m" if image is image_points else "grid": where}
        refuse(lambda i=image, p=places: i(**right | p | {name: wrong}), f"{name}: ", place)


@pytest.mark.parametrize("points_m", [np.ones((40, 2)), np.ones(()), np.full((1, 3), np.nan)])
def test_places_that_are_no_points_are_named(points_m):
    refuse(lambda: image_points(ECHOES, TONES_HZ, ARRAY, points_m, None), "points_m: ")
