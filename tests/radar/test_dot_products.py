"""Every path of the engine is the adjoint of its counterpart: ⟨A x, y⟩ = ⟨x, Aᴴ y⟩."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, AntennaPairs
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume
from handbench.radar.imaging.device import use_device
from handbench.radar.simulation.forward import operator
from tests.radar.direct_sums import direct_echoes
from tests.radar.samples import noise, relative_error
from tests.refusals import refuse

pytestmark = pytest.mark.usefixtures("planned")
APERTURES = ["array", "array with gaps", "pairs", "transceiver"]
SINGLE = 1e-6  # of float32: several times what sums in it lose here


def drawn(kind):
    """Antennas of this kind about the origin, the channels that they measure, tones in no order,
    and a grid before them."""
    draw = np.random.default_rng(APERTURES.index(kind))
    count = draw.integers(20, 30, 2) if "array" in kind else [150, 150]
    tx_m, rx_m = (draw.uniform([-0.08, -0.08, -0.004], [0.08, 0.08, 0.004], (n, 3)) for n in count)
    if "array" in kind:
        measured = draw.random(count) < (0.7 if "gaps" in kind else 1)
        aperture = AntennaArray(tx_m, rx_m, measured)
    else:
        measured = np.ones(150, bool)
        aperture = AntennaPairs(tx_m, rx_m if kind == "pairs" else tx_m)
    low_m = draw.uniform([-0.08, -0.08, 0.2], [0.04, 0.04, 0.35])
    axes_m = [at_m + 0.0015 * np.arange(n) for at_m, n in zip(low_m, (15, 17, 5), strict=True)]
    return aperture, measured, draw.uniform(72e9, 82e9, 8), VoxelGrid(*axes_m)


def mismatch(echoes, image, x, y):
    """|⟨A x, y⟩ − ⟨x, Aᴴ y⟩| over ‖A x‖ ‖y‖ + ‖x‖ ‖Aᴴ y‖, to which relative errors of the products
    add up."""
    x, y, echoes, image = (np.asarray(v, np.complex128).ravel() for v in (x, y, echoes, image))
    norms = [np.linalg.norm(v) for v in (echoes, y, x, image)]
    return abs(np.vdot(y, echoes) - np.vdot(image, x)) / (norms[0] * norms[1] + norms[2] * norms[3])


@pytest.mark.parametrize("tolerance", [None, 1e-3, 1e-5])
@pytest.mark.parametrize("as_points", [False, True])
@pytest.mark.parametrize("kind", APERTURES[:2])
def test_the_operators_products_are_adjoint(kind, as_points, tolerance):
    array, measured, tones_hz, grid = drawn(kind)
    points_m = grid.points_m().reshape(-1, 3)
    model = operator(array, tones_hz, points_m if as_points else grid, tolerance)
    x = noise(model.shape[1:])
    echoes = model @ x
    y = echoes + np.abs(echoes).mean() * noise(echoes.shape, 1)
    assert mismatch(echoes, model.H @ y, x, y) < (tolerance or SINGLE)
    unspread = direct_echoes(points_m, x, tones_hz, array) * measured
    assert relative_error(echoes, unspread.ravel()) < (tolerance or SINGLE)


@pytest.mark.parametrize("tolerance", [None, 1e-3])
@pytest.mark.parametrize("kind", APERTURES)
def test_imaging_is_the_adjoint_of_the_plain_sum(kind, tolerance, device):
    """Volumes, planes and points, their tones together and apart, on a GPU or its stand-in too."""
    aperture, measured, tones_hz, grid = drawn(kind)
    plane = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[:1])
    points_m = grid.points_m().reshape(-1, 3)
    for image, places in ((image_volume, grid), (image_volume, plane), (image_points, points_m)):
        at_m = plane.points_m().reshape(-1, 3) if places is plane else points_m
        x = noise(len(at_m))
        echoes = direct_echoes(at_m, x, tones_hz, aperture) * measured
        y = (echoes + np.abs(echoes).mean() * noise(echoes.shape, 1) * measured).astype("c8")
        for name, apart in ((name, apart) for name in ("cpu", device) for apart in (False, True)):
            with use_device(name):
                images = image(y, tones_hz, aperture, places, tolerance, per_tone=apart)
            images = images.sum(axis=0) if apart else images
            assert mismatch(echoes, images, x, y) < (tolerance or SINGLE)


def test_a_scan_has_no_operator():
    scan = drawn("pairs")[0]
    refuse(lambda: operator(scan, [80e9], np.ones((1, 3))), "array: ", "AntennaPairs")
