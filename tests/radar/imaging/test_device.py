"""Imaging as array code agrees with the processor's kernels: on a CUDA device, or where there is
none, behind a strict stand-in for CuPy."""

import os
import sys

import numpy as np
import pytest

from handbench.cli import reconstruct
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray, AntennaPairs, qar50
from handbench.radar.data.grid import Axis, VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.device import (
    SETTING,
    array_module,
    cis,
    current_device,
    describe,
    use_device,
)
from handbench.radar.imaging.gpu import executor, levels
from handbench.radar.methods.backprojection import Backprojection
from handbench.support.errors import HandbenchError
from tests.radar.direct_sums import direct_sum
from tests.radar.imaging.cupy_stand_in import cupy_stand_in, has_gpu
from tests.radar.imaging.measure_gpu import measure
from tests.radar.samples import always_planned, noise, relative_error

TONES_HZ = np.linspace(72e9, 82e9, 16)
AGREED = 1e-5  # of device and processor: both err by less in single precision


@pytest.fixture
def device(monkeypatch) -> str:
    """A device to image on: CUDA's, or where there is none, its stand-in."""
    if not has_gpu():
        monkeypatch.setitem(sys.modules, "cupy", cupy_stand_in())
    return "cuda"


def on(device: str, image, *arguments):
    """image(*arguments) on a device and on the processor."""
    with use_device(device):
        there = image(*arguments)
    with use_device("cpu"):
        return there, image(*arguments)


def scan(positions: int) -> AntennaPairs:
    """Positions strewn over a plane."""
    generator = np.random.default_rng(3)
    return AntennaPairs(
        *2 * [np.c_[generator.uniform(-0.1, 0.1, (positions, 2)), np.zeros(positions)]]
    )


def corner(nx=23, ny=29, nz=21) -> VoxelGrid:
    """A corner of the paper's volume."""
    return VoxelGrid(
        0.1 + 1e-3 * np.arange(nx), -0.15 + 1e-3 * np.arange(ny), 0.245 + 1e-3 * np.arange(nz)
    )


ARRAY = AntennaArray(
    qar50().tx_m[::3], qar50().rx_m[::4]
)  # 32 × 24: enough to be thinned, and quickly planned
PAIRS = AntennaPairs(scan(50).tx_m, scan(50).tx_m + [0.01, 0.02, 0.0])
PLANE_M = 1e-3 * np.arange(-30, 31)
APERTURES = {
    "array": ARRAY,
    "one receiver": AntennaArray(ARRAY.tx_m, ARRAY.rx_m[:1]),
    "scan": scan(60),
    "pairs": PAIRS,
}


@pytest.mark.parametrize("aperture", APERTURES.values(), ids=APERTURES)
@pytest.mark.parametrize("tolerance", [None, 1e-3])
@pytest.mark.parametrize("apart", [False, True])
def test_points(device, aperture, tolerance, apart):
    tones_hz = TONES_HZ[::5] if apart else TONES_HZ
    samples = noise((len(tones_hz), *aperture.channels))
    points_m = np.random.default_rng(1).uniform(-0.03, 0.03, (5, 61, 3)) + [0.0, 0.05, 0.3]
    with always_planned():
        there, here = on(
            device, image_points, samples, tones_hz, aperture, points_m, tolerance, apart
        )
    assert there.shape == here.shape and there.dtype == np.complex64
    assert relative_error(there, here) < AGREED
    reference = direct_sum(samples, tones_hz, aperture, points_m.reshape(-1, 3), apart)
    assert relative_error(there.reshape(reference.shape), reference) < (tolerance or AGREED)


@pytest.mark.parametrize(
    ("aperture", "tones", "tolerance", "apart", "carrier"),
    [
        *((aperture, 16, None, False, True) for aperture in APERTURES.values()),
        *((aperture, 16, 1e-3, False, True) for aperture in APERTURES.values()),
        (scan(1100), 3, 1e-3, False, True),  # too many for skeletons
        (qar50(), 16, 1e-3, False, False),
        (ARRAY, 3, 1e-4, True, True),
    ],
)
def test_volumes(device, aperture, tones, tolerance, apart, carrier):
    samples = noise((tones, *aperture.channels))
    there, here = on(
        device,
        image_volume,
        samples,
        TONES_HZ[:tones],
        aperture,
        corner(),
        tolerance,
        apart,
        carrier,
    )
    assert there.shape == here.shape and relative_error(there, here) < AGREED


@pytest.mark.parametrize("planes", [1, 21])
def test_projections(device, planes):
    grid = corner(nz=planes)
    arguments = (noise((16, 32, 24)), TONES_HZ, ARRAY, grid, 1e-3)
    (index, there), (expected, here) = on(device, project_volume, *arguments)
    assert np.array_equal(index, expected)
    # A voxel's rounding errors are those of its terms, and so in proportion to the whole image, not
    # to the voxel, whose terms may cancel.
    off = AGREED * float(np.nanmax(here))
    np.testing.assert_allclose(there, here, rtol=0, atol=off)  # NaN at the ends
    assert np.isnan(there).any()


def test_small_blocks_and_points_in_new_places_change_nothing(device, monkeypatch):
    """A plan of a device grows with what is imaged, and its parts stay valid."""
    points_m, samples = corner().points_m()[::4, ::4, ::4], noise((16, 32, 24))

    def everything():
        volume = image_volume(samples, TONES_HZ, ARRAY, corner(nz=20), 1e-3)  # a plan of its own
        parts = (points_m[:1], points_m[1:], points_m[:1])
        with always_planned():
            return [volume, *(image_points(samples, TONES_HZ, ARRAY, m, 1e-3) for m in parts)]

    for module in (levels, executor):
        monkeypatch.setattr(module, "BLOCK_BYTES", 1 << 21)
    for there, here in zip(*on(device, everything), strict=True):
        assert relative_error(there, here) < AGREED


@pytest.mark.parametrize("kept_bytes", [0, executor.KEPT_BYTES])
def test_further_frames_use_their_own_samples_and_depths(device, monkeypatch, kept_bytes):
    """What stays on the device between frames depends on the plan alone."""
    monkeypatch.setattr(executor, "KEPT_BYTES", kept_bytes)
    frames = [noise((4, 32, 24)) * factor for factor in (1, 2j, 3)]
    plane, deeper = (VoxelGrid(PLANE_M, PLANE_M, np.array([z_m])) for z_m in (0.27, 0.271))
    grids = [corner(nz=9)] * 3 + [plane, plane, deeper]

    def everything():
        return [
            image_volume(samples, TONES_HZ[:4], ARRAY, grid, 1e-3)
            for samples, grid in zip(frames * 2, grids, strict=True)
        ]

    for there, here in zip(*on(device, everything), strict=True):
        assert relative_error(there, here) < AGREED


def test_a_plan_follows_the_choice_of_device(device, monkeypatch):
    """The same plan and points on one device after another: what each keeps is its own."""
    arguments = (noise((16, 32, 24)), TONES_HZ, ARRAY, corner(), 1e-3)
    modules = []
    monkeypatch.setattr(levels, "cis", lambda xp, turns: modules.append(xp) or cis(xp, turns))
    for name in ("numpy", device):
        with use_device(name):
            image_volume(*arguments)
            assert modules[-1] is array_module()


def test_the_choice_holds_until_the_block_ends(device, monkeypatch):
    seen = []
    monkeypatch.setattr(reconstruct, "run", lambda _: seen.append(describe()))
    for option, setting in ((["--device", "cuda"], "numpy"), ([], "cuda")):
        monkeypatch.setenv(SETTING, setting)
        words = ["reconstruct", "here", "--method", "3fsk", "-o", "depth.npz", *option]
        assert main(words) == 0 and current_device() == setting
    assert seen == [describe("cuda")] * 2 and seen[0].startswith("cuda: ")
    monkeypatch.delenv(SETTING)
    with use_device(None):
        assert current_device() == describe() == "cpu"
    assert SETTING not in os.environ


def no_device() -> int:
    raise RuntimeError("cudaErrorNoDevice: none is detected")


def no_product(*_):
    raise RuntimeError("no libcublas.so.12")


def out_of_memory(*_):
    raise MemoryError("out of memory allocating 1,000 bytes")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (None, "needs CuPy, which is not installed; run pip install 'handbench[gpu]'"),
        ({"count": lambda: 0}, "no CUDA device was found (the NVIDIA driver reports none); leave"),
        ({"count": no_device}, "no CUDA device was found (cudaErrorNoDevice: none is detected)"),
        ({"matmul": no_product}, "cannot compute on it (no libcublas.so.12)"),
        ({"empty": out_of_memory}, "device is full (out of memory allocating 1,000 bytes)"),
    ],
)
def test_a_device_that_is_missing_or_fails_is_named_in_one_line(change, message, monkeypatch):
    module = cupy_stand_in()
    for name, value in (change or {}).items():
        if name == "count":
            module.cuda.runtime.getDeviceCount = value
        else:
            setattr(module, name, value)
    monkeypatch.setitem(sys.modules, "cupy", module if change is not None else None)
    with pytest.raises(HandbenchError) as error, use_device("cuda"):
        image_points(noise((16, 32, 24)), TONES_HZ, ARRAY, np.ones((1, 3)), None)
    assert str(error.value).startswith("--device cuda: ") and message in str(error.value)


def test_unknown_devices_are_refused(monkeypatch):
    monkeypatch.setenv(SETTING, "tpu")
    with pytest.raises(HandbenchError, match="is 'tpu'; set it to cpu or cuda or numpy"):
        current_device()
    with pytest.raises(HandbenchError, match="'cpu' cannot run array code"):
        array_module("cpu")


@pytest.mark.slow
def test_the_measurement_of_a_device(device):
    axis, depth = (Axis(start_m=a, stop_m=b, step_m=1e-3) for a, b in ((-0.01, 0.01), (0.27, 0.29)))
    with use_device(device):
        found = measure(
            Backprojection(x=axis, y=axis, z=depth, tones_hz={"count": 8}), 1e-3, repeats=1
        )
    assert found["error"] < 1e-3 and found["ms"] > 0
