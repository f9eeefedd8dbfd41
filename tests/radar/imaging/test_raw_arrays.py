"""Imaging functions given what no capture holds: the right image, or an error that names the
argument."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, PlanarScan
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.cpu.exact import path_lengths
from handbench.support.errors import HandbenchError
from tests.radar.direct_sums import direct_sum
from tests.radar.exact import backproject

pytestmark = pytest.mark.usefixtures("planned")

RANDOM = np.random.default_rng(0)
ARRAY = AntennaArray(
    RANDOM.uniform(-0.07, 0.07, (6, 3)) * [1, 1, 0], RANDOM.uniform(-0.07, 0.07, (5, 3)) * [1, 1, 0]
)
SCAN = PlanarScan(RANDOM.uniform(-0.07, 0.07, (9, 3)) * [1, 1, 0])
TONES_HZ = np.array([72e9, 82e9, 80e9])
POINTS_M = RANDOM.uniform(-0.03, 0.03, (40, 3)) + [0, 0, 0.3]
AXIS_M = np.linspace(-0.02, 0.02, 9)
GRID = VoxelGrid(AXIS_M, AXIS_M, AXIS_M + 0.3)


def echoes(aperture=ARRAY, tones_hz=TONES_HZ):
    path_m = path_lengths(aperture, np.array([0.005, 0.002, 0.3]))
    return np.exp(-2j * np.pi * np.multiply.outer(tones_hz, path_m) / 299_792_458.0)


def images(samples, tones_hz=TONES_HZ, aperture=ARRAY, points_m=POINTS_M):
    """Every imaging function's image, by name."""
    for tolerance in (None, 1e-3):
        yield image_points(samples, tones_hz, aperture, points_m, tolerance)
        yield image_points(samples, tones_hz, aperture, points_m, tolerance, apart=True)
        yield image_volume(samples, tones_hz, aperture, GRID, tolerance)
        yield project_volume(samples, tones_hz, aperture, GRID, tolerance).magnitude


@pytest.mark.parametrize("aperture", [ARRAY, SCAN])
@pytest.mark.parametrize("scale", [1e300, 1e38, 1e25, 1e-25, 1e-42, 1e-300])
def test_an_image_scales_with_its_samples(scale, aperture):
    """Against the image of the samples near 1: it shares the engine, and not the scale."""
    samples = echoes(aperture)
    for scaled, plain in zip(
        images(samples * scale, TONES_HZ, aperture),
        images(samples, TONES_HZ, aperture),
        strict=True,
    ):
        np.testing.assert_allclose(
            scaled / scale, plain, rtol=1e-3, atol=1e-4 * np.nanmax(np.abs(plain))
        )


def test_the_direct_sum_agrees_at_any_scale():
    for scale in (1e300, 1e-300):
        exact = direct_sum(echoes() * scale, TONES_HZ, ARRAY, POINTS_M)
        image = image_points(echoes() * scale, TONES_HZ, ARRAY, POINTS_M, None)
        assert np.linalg.norm(image / scale - exact / scale) < 1e-5 * np.linalg.norm(exact / scale)


def test_one_sample_beyond_all_others_gives_its_image():
    samples = echoes()
    samples[0, 1, 2] = 1e300
    alone = np.zeros_like(samples)
    alone[0, 1, 2] = 1.0
    image = image_points(samples, TONES_HZ, ARRAY, POINTS_M, None)
    np.testing.assert_allclose(
        image / 1e300, image_points(alone, TONES_HZ, ARRAY, POINTS_M, None), atol=1e-5
    )


def test_ordinary_samples_keep_their_type_and_zeros_are_zeros():
    assert {image.dtype for image in images(echoes())} == {np.dtype("c8"), np.dtype("f4")}
    assert not image_points(np.zeros_like(echoes()), TONES_HZ, ARRAY, POINTS_M, 1e-3).any()


def replaced(values, place, value):
    values = values.astype(np.result_type(values, np.min_scalar_type(value)))
    values[place] = value
    return values


@pytest.mark.parametrize(
    "samples, reason",
    [
        (replaced(echoes(), (0, 1, 2), np.nan), "hold NaN"),
        (replaced(echoes(), (2, 5, 4), 1j * np.inf), "hold NaN, infinity"),
        (echoes().astype(object), "object"),
        (np.full(echoes().shape, "a"), "<U1"),
        (echoes()[:, :5], "have shape"),
        (np.full(echoes().shape, 1e308), "more than a number holds"),
    ],
)
def test_samples_that_are_none_are_named(samples, reason):
    for image in (image_points, image_volume, project_volume):
        with pytest.raises(HandbenchError, match=f"^samples: .*{reason}"):
            image(samples, TONES_HZ, ARRAY, POINTS_M if image is image_points else GRID, 1e-3)
    if reason != "more than a number holds":
        with pytest.raises(HandbenchError, match=f"^samples: .*{reason}"):
            backproject(samples, TONES_HZ, ARRAY, POINTS_M)


@pytest.mark.parametrize(
    "tones_hz",
    [
        [72e9, np.nan, 80e9],
        [72e9, np.inf, 80e9],
        [72e9, -82e9, 80e9],
        [72e9, 0.0, 80e9],
        [72e9, 1e300, 80e9],
        np.array(["a", "b", "c"]),
        TONES_HZ.astype(complex),
        TONES_HZ[:, None],
        [],
    ],
)
def test_tones_that_are_none_are_named(tones_hz):
    for image in (image_points, image_volume, project_volume):
        with pytest.raises(HandbenchError, match=r"^frequencies_hz: "):
            image(echoes(), tones_hz, ARRAY, POINTS_M if image is image_points else GRID, 1e-3)
    for function in (backproject, direct_sum):
        with pytest.raises(HandbenchError, match=r"^frequencies_hz: "):
            function(echoes(), np.array(tones_hz), ARRAY, POINTS_M)
    with pytest.raises(HandbenchError, match=r"^frequencies_hz: "):
        RadarCapture(echoes()[None].astype(np.complex64), np.array(tones_hz), ARRAY)


@pytest.mark.parametrize("tones_hz", [[82e9, 72e9, 80e9], [80e9, 80e9, 72e9]])
def test_tones_in_any_order_and_twice_give_the_right_image(tones_hz):
    """Against the formula in float64."""
    samples = echoes(tones_hz=np.array(tones_hz))
    exact = direct_sum(samples, np.array(tones_hz), ARRAY, POINTS_M)
    for tolerance in (None, 1e-3):
        image = image_points(samples, tones_hz, ARRAY, POINTS_M.tolist(), tolerance)
        assert np.linalg.norm(image - exact) < (1e-3 if tolerance else 1e-5) * np.linalg.norm(exact)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e9])
def test_places_that_are_none_are_named(wrong):
    points_m = replaced(POINTS_M, (3, 1), wrong)
    for tolerance in (None, 1e-3):
        with pytest.raises(HandbenchError, match=r"^points_m: "):
            image_points(echoes(), TONES_HZ, ARRAY, points_m, tolerance)
    with pytest.raises(HandbenchError, match=r"^points_m: "):
        direct_sum(echoes(), TONES_HZ, ARRAY, points_m)
    with pytest.raises(HandbenchError, match=r"^tx_m: "):
        AntennaArray(points_m, ARRAY.rx_m)
    for shape in ((40, 2), (3, 1), ()):
        with pytest.raises(HandbenchError, match=r"^points_m: "):
            image_points(echoes(), TONES_HZ, ARRAY, np.ones(shape), None)


@pytest.mark.parametrize("scale", [1e300, 1e-300])
def test_samples_that_a_file_cannot_hold_are_refused(scale, tmp_path):
    capture = RadarCapture(echoes()[None] * scale, TONES_HZ, ARRAY)
    with pytest.raises(HandbenchError, match=r"^samples: reach"):
        save_capture(tmp_path / "echoes.h5", capture)
    assert not (tmp_path / "echoes.h5").exists()
