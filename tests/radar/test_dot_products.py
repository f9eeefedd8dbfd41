"""Every path of the engine is the adjoint of its counterpart: ⟨A x, y⟩ = ⟨x, Aᴴ y⟩."""

import sys

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, AntennaPairs
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume
from handbench.radar.imaging.device import use_device
from handbench.radar.operator import operator
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.errors import HandbenchError
from tests.radar.direct_sums import direct_echoes
from tests.radar.imaging.cupy_stand_in import cupy_stand_in, has_gpu
from tests.radar.samples import noise

pytestmark = pytest.mark.usefixtures("planned")
TOLERANCES = [None, 1e-3, 1e-5]
APERTURES = ["array", "pairs", "transceiver", "array with gaps"]


def drawn(seed, kind="array"):
    """Antennas of this kind about the origin, tones in no order, and a grid before them."""
    draw = np.random.default_rng(seed)
    count = draw.integers(20, 30, 2) if kind.startswith("array") else [150, 150]
    tx_m, rx_m = (draw.uniform([-0.08, -0.08, -0.004], [0.08, 0.08, 0.004], (n, 3)) for n in count)
    measured = draw.random(count) < 0.7 if kind == "array with gaps" else None
    aperture = {"pairs": AntennaPairs, "transceiver": lambda tx_m, _: AntennaPairs(tx_m, tx_m)}.get(
        kind, lambda *ends_m: AntennaArray(*ends_m, measured)
    )(tx_m, rx_m)
    low_m = draw.uniform([-0.08, -0.08, 0.2], [0.04, 0.04, 0.35])
    axes_m = [at_m + 0.0015 * np.arange(n) for at_m, n in zip(low_m, (15, 17, 5), strict=True)]
    return aperture, draw.uniform(72e9, 82e9, 8), VoxelGrid(*axes_m)


def mismatch(echoes, image, x, y):
    """|⟨A x, y⟩ − ⟨x, Aᴴ y⟩| over ‖A x‖ ‖y‖ + ‖x‖ ‖Aᴴ y‖, to which relative errors of the products
    add up."""
    x, y, echoes, image = (np.asarray(v, np.complex128).ravel() for v in (x, y, echoes, image))
    norms = [np.linalg.norm(v) for v in (echoes, y, x, image)]
    return abs(np.vdot(y, echoes) - np.vdot(image, x)) / (norms[0] * norms[1] + norms[2] * norms[3])


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("as_points", [False, True])
@pytest.mark.parametrize("kind", APERTURES[::3])
def test_the_operators_products_are_adjoint(kind, as_points, tolerance):
    array, tones_hz, grid = drawn(1, kind)
    points_m = grid.points_m().reshape(-1, 3)
    model = operator(array, tones_hz, points_m if as_points else grid, tolerance)
    x = noise(model.shape[1:])
    echoes = model @ x
    y = echoes + np.linalg.norm(echoes) / len(echoes) ** 0.5 * noise(echoes.shape, 1)
    assert mismatch(echoes, model.H @ y, x, y) < (tolerance or 1e-6)
    unspread = direct_echoes(points_m, x, tones_hz, array)
    live = 1 if array.measured is None else array.measured
    error = np.linalg.norm(echoes - (unspread * live).ravel()) / np.linalg.norm(echoes)
    assert error < (tolerance or 1e-6)


@pytest.mark.parametrize("tolerance", TOLERANCES[:2])
@pytest.mark.parametrize("device", ["cpu", "cuda"])
@pytest.mark.parametrize("kind", APERTURES[:3])
def test_imaging_is_the_adjoint_of_the_plain_sum(kind, device, tolerance, monkeypatch):
    """Volumes, planes and points, their tones together and apart, on a GPU's stand-in too."""
    if device == "cuda" and not has_gpu():
        monkeypatch.setitem(sys.modules, "cupy", cupy_stand_in())
    aperture, tones_hz, grid = drawn(APERTURES.index(kind), kind)
    plane = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[:1])
    points_m = grid.points_m().reshape(-1, 3)
    with use_device(device):
        for image, places in (
            (image_volume, grid),
            (image_volume, plane),
            (image_points, points_m),
        ):
            at_m = plane.points_m().reshape(-1, 3) if places is plane else points_m
            x = noise(len(at_m))
            echoes = direct_echoes(at_m, x, tones_hz, aperture)
            y = (echoes + np.abs(echoes).mean() * noise(echoes.shape, 1)).astype(np.complex64)
            for apart in (False, True):
                images = image(y, tones_hz, aperture, places, tolerance, per_tone=apart)
                images = images.sum(axis=0) if apart else images
                assert mismatch(echoes, images, x, y) < (tolerance or 1e-6)


@pytest.mark.parametrize("tolerance", TOLERANCES)
@pytest.mark.parametrize("normals", [False, True])
def test_echoes_with_gains_are_those_of_the_sum(normals, tolerance):
    """Spreading, obliquity and the antennas' pattern: against the adjoint of the sum itself."""
    array, tones_hz, grid = drawn(4)
    points_m = grid.points_m().reshape(-1, 3)
    x, towards = noise(len(points_m)), noise((2, len(points_m), 3)).real[0] - [0, 0, 4]
    normal_m = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    scatterers = Scatterers(points_m, x, normal_m if normals else None)
    echoes = simulate(scatterers, tones_hz, array, True, tolerance, pattern=1.5)
    y, image = echoes + np.abs(echoes).mean() * noise(echoes.shape, 1), 0
    legs = []
    for end_m in (array.tx_m, array.rx_m):
        away_m = end_m[:, None] - points_m
        length_m = np.linalg.norm(away_m, axis=2)
        facing = np.sum(away_m * normal_m, axis=2) / length_m if normals else 1.0
        gain = np.sqrt(np.maximum(facing, 0)) / length_m * (-away_m[..., 2] / length_m) ** 1.5
        legs.append((length_m, gain))
    for samples, tone_hz in zip(y, tones_hz, strict=True):
        turns = 2j * np.pi * tone_hz / SPEED_OF_LIGHT_M_S
        to, back = (gain * np.exp(turns * length_m) for length_m, gain in legs)
        image = image + np.einsum("tr,tp,rp->p", samples, to, back, optimize=True)
    assert mismatch(echoes, image, x, y) < (tolerance or 1e-6)


def test_a_scan_has_no_operator():
    with pytest.raises(HandbenchError, match="array: is an AntennaPairs"):
        operator(AntennaPairs(np.zeros((1, 3)), np.zeros((1, 3))), [80e9], np.ones((1, 3)))
