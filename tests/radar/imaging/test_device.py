"""Imaging as array code agrees with the processor's kernels: on a CUDA device, or where there is
none, behind a strict stand-in for CuPy."""

import os
import sys

import numpy as np
import pytest

from handbench.cli import imaging
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray, AntennaPairs, qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging import gpu
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.device import (
    SETTING,
    array_module,
    current_device,
    describe,
    use_device,
)
from tests.radar.imaging.cupy_stand_in import cupy_stand_in
from tests.radar.samples import always_planned, noise, relative_error
from tests.refusals import refuse

TONES_HZ = np.linspace(72e9, 82e9, 16)
AGREED = 1e-5  # of device and processor: both err by less in single precision
# 32 × 24: enough to be thinned, and quickly planned
ARRAY = AntennaArray(qar50().tx_m[::3], qar50().rx_m[::4])
ONE = AntennaArray(ARRAY.tx_m, ARRAY.rx_m[:1])
POSITIONS_M = np.random.default_rng(3).uniform(-0.1, 0.1, (1100, 3)) * [1, 1, 0]
SCAN = AntennaPairs(POSITIONS_M, POSITIONS_M)  # with too many positions for skeletons
SAMPLES = noise((16, *ARRAY.channels))


def on(device: str, image, *arguments):
    """image(*arguments) on a device and on the processor."""
    with use_device(device):
        there = image(*arguments)
    return there, image(*arguments)


def corner(nx=23, ny=29, nz=21) -> VoxelGrid:
    """A corner of the paper's volume."""
    x_m, y_m, z_m = (1e-3 * np.arange(n) for n in (nx, ny, nz))
    return VoxelGrid(0.1 + x_m, -0.15 + y_m, 0.245 + z_m)


@pytest.mark.parametrize(
    ("aperture", "tones", "carrier"), [(ONE, 16, True), (SCAN, 3, True), (ARRAY, 16, False)]
)
def test_volumes(device, aperture, tones, carrier):
    samples = noise((tones, *aperture.channels))
    options = aperture, corner(), 1e-3, False, carrier
    there, here = on(device, image_volume, samples, TONES_HZ[:tones], *options)
    assert relative_error(there, here) < AGREED


@pytest.mark.parametrize("planes", [1, 21])
def test_projections(device, planes):
    arguments = SAMPLES, TONES_HZ, ARRAY, corner(nz=planes), 1e-3
    (index, there), (expected, here) = on(device, project_volume, *arguments)
    np.testing.assert_array_equal(index, expected)
    # A voxel's rounding errors are those of its terms, and so in proportion to the whole image, not
    # to the voxel, whose terms may cancel.
    np.testing.assert_allclose(there, here, rtol=0, atol=AGREED * np.nanmax(here))
    assert np.isnan(there).any()  # at the ends


def test_small_blocks_and_points_in_new_places_change_nothing(device, monkeypatch):
    """A plan of a device grows with what is imaged, and its parts stay valid."""
    points_m = corner().points_m()[::4, ::4, ::4]

    def everything():
        # a plan of its own
        yield image_volume(SAMPLES, TONES_HZ, ARRAY, corner(nz=20), 1e-3)
        for part_m in (points_m[:1], points_m[1:], points_m[:1]):
            yield image_points(SAMPLES, TONES_HZ, ARRAY, part_m, 1e-3)

    monkeypatch.setattr(gpu, "BLOCK_BYTES", 1 << 21)
    with always_planned():
        for there, here in zip(*on(device, lambda: [*everything()]), strict=True):
            assert relative_error(there, here) < AGREED


@pytest.mark.parametrize("kept_bytes", [0, gpu.KEPT_BYTES])
def test_further_frames_use_their_own_samples_and_depths(device, monkeypatch, kept_bytes):
    """What stays on the device between frames depends on the plan alone, and on the device."""
    monkeypatch.setattr(gpu, "KEPT_BYTES", kept_bytes)
    along_m, frames = 1e-3 * np.arange(-30, 31), (SAMPLES[:4], 2j * SAMPLES[4:8])
    plane, deeper = (VoxelGrid(along_m, along_m, np.array([z_m])) for z_m in (0.27, 0.271))

    def everything():
        return [
            image_volume(samples, TONES_HZ[:4], ARRAY, grid, 1e-3)
            for grid in (corner(nz=9), plane, deeper)
            for samples in frames
        ]

    with use_device("numpy"):
        everything()
    for there, here in zip(*on(device, everything), strict=True):
        assert relative_error(there, here) < AGREED


def test_the_choice_holds_until_the_block_or_the_command_ends(device, monkeypatch):
    seen = []
    monkeypatch.setattr(imaging, "reconstruct", lambda _: seen.append(current_device()))
    monkeypatch.setenv(SETTING, "numpy")
    words = ["reconstruct", "here", "--method", "3fsk", "-o", "depth.npz"]
    assert main([*words, "--device", device]) == main(words) == 0
    assert seen == ["cuda", "numpy"]
    with use_device(device):
        assert describe().startswith("cuda: ")
        with use_device(None):
            assert current_device() == "cuda"
    assert describe() == "numpy"
    monkeypatch.delenv(SETTING)
    with use_device(None):
        assert current_device() == describe() == "cpu"
    assert SETTING not in os.environ


def failing(error: Exception):
    """A function that ends in this error."""

    def call(*_):
        raise error

    return call


@pytest.mark.parametrize(
    ("name", "function", "place"),
    [
        (None, None, "CuPy"),
        ("getDeviceCount", lambda: 0, "CUDA"),
        ("getDeviceCount", failing(RuntimeError("cudaErrorNoDevice")), "cudaErrorNoDevice"),
        ("matmul", failing(RuntimeError("no libcublas.so.12")), "libcublas.so.12"),
        ("empty", failing(MemoryError("1,000 bytes")), "1,000 bytes"),
    ],
)
def test_a_device_that_is_missing_or_fails_is_named(name, function, place, monkeypatch):
    module = None if name is None else cupy_stand_in()
    if module is not None:
        owner = module.cuda.runtime if name == "getDeviceCount" else module
        setattr(owner, name, function)
    monkeypatch.setitem(sys.modules, "cupy", module)

    def image():
        with use_device("cuda"):
            image_points(SAMPLES, TONES_HZ, ARRAY, np.ones((1, 3)), None)

    refuse(image, "--device cuda: ", place)


def test_unknown_devices_are_refused(monkeypatch):
    monkeypatch.setenv(SETTING, "tpu")
    refuse(current_device, SETTING, "tpu")
    refuse(lambda: array_module("cpu"), "'cpu'")
