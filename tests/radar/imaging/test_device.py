"""Imaging as array code, in numpy and behind a strict stand-in for CuPy, agrees with the
processor's kernels."""

import json
import os
import sys

import numpy as np
import pytest

from handbench.cli import reconstruct
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray, BistaticScan, PlanarScan, qar50
from handbench.radar.data.grid import Axis, VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.device import SETTING, array_module, chosen, describe, use_device
from handbench.radar.imaging.gpu import executor, levels
from handbench.radar.imaging.plan import TreePlan
from handbench.radar.imaging.tree import Box, Family
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig
from handbench.support.errors import HandbenchError
from handbench.bench.studies import study
from tests.radar.direct_sums import direct_sum
from tests.radar.imaging import measure_gpu
from tests.radar.imaging.cupy_stand_in import DeviceArray, cupy_stand_in
from tests.radar.samples import noise, relative_error
from tests.radar.simulated_points import around, points_capture

TONES_HZ = np.linspace(72e9, 82e9, 16)
AGREED = 1e-5  # of device and processor: both err by less in single precision


@pytest.fixture
def device(monkeypatch) -> str:
    """A device to image on: CUDA's stand-in."""
    monkeypatch.setitem(sys.modules, "cupy", cupy_stand_in())
    return "cuda"


def on(device: str, image, *arguments):
    """image(*arguments) on a device and on the processor."""
    with use_device(device):
        there = image(*arguments)
    with use_device("cpu"):
        return there, image(*arguments)


def scan(positions: int) -> PlanarScan:
    """Positions strewn over a plane."""
    generator = np.random.default_rng(3)
    return PlanarScan(np.c_[generator.uniform(-0.1, 0.1, (positions, 2)), np.zeros(positions)])


def corner(nx=23, ny=29, nz=21) -> VoxelGrid:
    """A corner of the paper's volume."""
    return VoxelGrid(
        0.1 + 1e-3 * np.arange(nx), -0.15 + 1e-3 * np.arange(ny), 0.245 + 1e-3 * np.arange(nz)
    )


ARRAY = AntennaArray(
    qar50().tx_m[::3], qar50().rx_m[::4]
)  # 32 × 24: enough to be thinned, and quickly planned
PAIRS = BistaticScan(scan(50).position_m, scan(50).position_m + [0.01, 0.02, 0.0])
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
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (5, 61, 3)) * [0.06, 0.04, 0.03] + [
        0.0,
        0.05,
        0.3,
    ]
    there, here = on(
        device, image_points, samples, tones_hz, aperture, points, tolerance, apart, True
    )
    assert there.shape == here.shape and there.dtype == np.complex64
    assert relative_error(there, here) < AGREED
    each = [slice(f, f + 1) for f in range(len(tones_hz))] if apart else [slice(None)]
    flat = points.reshape(-1, 3)
    reference = np.stack([direct_sum(samples[f], tones_hz[f], aperture, flat) for f in each])
    assert relative_error(there.reshape(reference.shape), reference) < (tolerance or AGREED)


@pytest.mark.parametrize("aperture", APERTURES.values(), ids=APERTURES)
@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_volumes(device, aperture, tolerance):
    grid, samples = corner(), noise((16, *aperture.channels))
    there, here = on(device, image_volume, samples, TONES_HZ, aperture, grid, tolerance)
    assert relative_error(there, here) < AGREED
    chosen_voxels = np.random.default_rng(2).integers(0, there.size, 40)
    reference = direct_sum(
        samples, TONES_HZ, aperture, grid.points_m().reshape(-1, 3)[chosen_voxels]
    )
    assert relative_error(there.ravel()[chosen_voxels], reference) < (tolerance or AGREED)


@pytest.mark.parametrize("device", ["cuda", "numpy"])
def test_the_paper_s_array_with_and_without_the_carrier(device, monkeypatch):
    monkeypatch.setitem(sys.modules, "cupy", cupy_stand_in())
    for carrier in (True, False):
        samples = noise((16, 94, 94))
        there, here = on(
            device, image_volume, samples, TONES_HZ, qar50(), corner(), 1e-3, False, carrier
        )
        assert relative_error(there, here) < AGREED


def test_a_single_plane_s_projection(device):
    grid = corner(nz=1)
    there, here = on(device, project_volume, noise((16, 32, 24)), TONES_HZ, ARRAY, grid, 1e-3)
    assert not there.index.any() and not here.index.any()
    np.testing.assert_allclose(there.magnitude, here.magnitude, rtol=1e-4)
    assert (there.rival == -1).all() and (there.second == here.second).all()


def test_a_crowded_scan(device):
    crowded, tones_hz = scan(1500), TONES_HZ[:3]
    there, here = on(device, image_volume, noise((3, 1500)), tones_hz, crowded, corner(), 1e-3)
    assert relative_error(there, here) < AGREED


def test_planes_at_any_depth_with_the_tones_apart(device):
    samples = noise((3, 32, 24))
    for z_m in (0.29, 0.2917):
        grid = VoxelGrid(1e-3 * np.arange(60), 1e-3 * np.arange(50), np.array([z_m]))
        there, here = on(device, image_volume, samples, TONES_HZ[:3], ARRAY, grid, 1e-4, True)
        assert there.shape == (3, 1, 50, 60)
        assert relative_error(there, here) < AGREED


def test_projections(device):
    there, here = on(device, project_volume, noise((16, 32, 24)), TONES_HZ, ARRAY, corner(), 1e-3)
    assert np.array_equal(there.index, here.index)
    np.testing.assert_allclose(
        there.magnitude, here.magnitude, rtol=1e-4
    )  # NaN where the other has it
    assert np.isnan(there.magnitude).any()
    assert np.array_equal(there.rival, here.rival) and there.error == pytest.approx(here.error)
    np.testing.assert_allclose(there.second, here.second, rtol=1e-4)


def test_small_blocks_change_nothing(device, monkeypatch):
    points = corner().points_m()[::4, ::4, ::4]

    def everything():
        samples = noise((16, 32, 24))
        volume = image_volume(
            samples, TONES_HZ, ARRAY, corner(nz=20), 1e-3
        )  # of another shape: a plan of its own
        return [volume, image_points(samples, TONES_HZ, ARRAY, points, None)]

    for module in (levels, executor):
        monkeypatch.setattr(module, "BLOCK_BYTES", 1 << 21)
    for there, here in zip(*on(device, everything), strict=True):
        assert relative_error(there, here) < AGREED


def test_limbs_are_planned_when_points_first_touch_them(device):
    with use_device(device):
        box = Box(np.array([-0.04, -0.04, 0.25]), np.array([0.04, 0.04, 0.35]))
        plan = TreePlan(TONES_HZ, ARRAY, box, Family(1e-3, False))
        engine = executor.Executor(plan)
        samples, points = noise((16, 32, 24)), np.array([[-0.03, -0.03, 0.26], [0.03, 0.03, 0.34]])
        first, second = plan.sort(points[:1]), plan.sort(points[1:])
        engine.place(first)
        sent = engine.place(second).limbs
        for row, where in enumerate(
            (first, second, plan.sort(points[:1]))
        ):  # the first stays valid
            reference = direct_sum(samples, TONES_HZ, ARRAY, points[row % 2][None])
            assert relative_error(engine.image(samples, where)[0], reference) < 1e-2
        assert (
            engine.place(plan.sort(points)).limbs is sent
        )  # all were planned, so that nothing was sent again


def test_a_frame_of_three_tones(device):
    points = np.array([[0.0, 0.0, 0.3]])
    config = ThreeToneConfig(**around(points[0]), first_depth_m=0.31, tolerance=1e-4)
    there, here = on(device, fsk_with_uncertainty, points_capture(points), config)
    np.testing.assert_allclose(there.z_m, here.z_m, atol=1e-6)


def test_the_stand_in_is_as_strict_as_a_device():
    array = cupy_stand_in().asarray(np.ones(3))
    for mixing in (
        lambda: array + np.ones(3),
        lambda: np.ones(3) + array,
        lambda: np.asarray(array),
        lambda: cupy_stand_in().stack([np.ones(3)]),
        lambda: array[np.arange(2)],
    ):
        with pytest.raises(TypeError):
            mixing()
    assert isinstance(2.0 * array, DeviceArray)


def test_the_choice_holds_until_the_block_ends(monkeypatch):
    monkeypatch.setenv(SETTING, "numpy")
    with use_device("cpu"):
        assert chosen() == describe() == "cpu"
    assert chosen() == "numpy"
    monkeypatch.delenv(SETTING)
    with use_device(None):
        assert chosen() == "cpu"
    assert SETTING not in os.environ


def no_device() -> int:
    raise RuntimeError("cudaErrorNoDevice: none is detected")


@pytest.mark.parametrize(
    ("count", "message"),
    [
        (None, "CuPy is not installed; pip install 'handbench[gpu]', or leave the option out"),
        (lambda: 0, "no CUDA device found (the driver counts none); leave the option out"),
        (
            no_device,
            "no CUDA device found (cudaErrorNoDevice: none is detected); leave the option out",
        ),
    ],
)
def test_without_a_device_every_door_says_so_in_one_line(count, message, monkeypatch, capsys):
    module = cupy_stand_in()
    module.cuda.runtime.getDeviceCount = count
    monkeypatch.setitem(sys.modules, "cupy", module if count else None)
    reconstruct = [
        "reconstruct",
        "nowhere",
        "--method",
        "3fsk",
        "-o",
        "depth.npz",
        "--device",
        "cuda",
    ]
    assert main(reconstruct) == 2
    assert capsys.readouterr().err == f"handbench: --device cuda: {message}\n"
    monkeypatch.setattr("sys.argv", ["measure_gpu"])
    with pytest.raises(SystemExit):
        measure_gpu.main()
    assert (
        capsys.readouterr().err
        == f"python -m tests.radar.imaging.measure_gpu: --device cuda: {message}\n"
    )
    monkeypatch.setenv(SETTING, "cuda")
    with pytest.raises(HandbenchError):
        image_points(noise((16, 32, 24)), TONES_HZ, ARRAY, np.ones((1, 3)), None)


def test_a_device_that_cannot_compute_or_is_full_is_a_known_error(monkeypatch):
    module = cupy_stand_in()
    monkeypatch.setitem(sys.modules, "cupy", module)
    with pytest.raises(HandbenchError, match="its memory is full"), use_device("cuda"):
        raise MemoryError("out of memory allocating 1,000 bytes")
    module.matmul = lambda *_: (_ for _ in ()).throw(RuntimeError("no libcublas.so.12"))
    with (
        pytest.raises(HandbenchError, match=r"cannot compute \(no libcublas\.so\.12\)"),
        use_device("cuda"),
    ):
        pass
    with pytest.raises(MemoryError), use_device("cpu"):
        raise MemoryError


def test_unknown_devices_are_refused(monkeypatch):
    monkeypatch.setenv(SETTING, "tpu")
    with pytest.raises(
        HandbenchError, match="HANDBENCH_DEVICE: is 'tpu'; expected cpu, cuda, numpy, or nothing"
    ):
        chosen()
    with pytest.raises(HandbenchError, match="'cpu' runs no array code"):
        array_module("cpu")


@pytest.mark.parametrize(("option", "setting"), [(["--device", "cuda"], "cpu"), ([], "cuda")])
def test_the_command_line_chooses(option, setting, device, monkeypatch):
    seen = []
    monkeypatch.setattr(reconstruct, "run", lambda _: seen.append(describe()))
    monkeypatch.setenv(SETTING, setting)
    assert main(["reconstruct", "somewhere", "--method", "3fsk", "-o", "depth.npz", *option]) == 0
    assert seen == ["cuda: Stand-in"]
    assert os.environ[SETTING] == setting


def test_the_benchmark_writes_its_rows(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "cupy", cupy_stand_in())
    monkeypatch.setattr(study, "compile_kernels", lambda: None)
    few, deep = (Axis(start_m=z - 0.004, stop_m=z + 0.004, step_m=0.001) for z in (0.0, 0.28))
    monkeypatch.setattr(measure_gpu, "SHARE", few)
    monkeypatch.setattr(
        measure_gpu, "BroadbandConfig", lambda: BroadbandConfig(x=few, y=few, z=deep, count=5)
    )
    monkeypatch.setattr(measure_gpu, "ThreeToneConfig", lambda: ThreeToneConfig(x=few, y=few))
    monkeypatch.setattr(
        "sys.argv", ["measure_gpu", "--repeats", "1", "-o", str(tmp_path / "gpu.json")]
    )
    measure_gpu.main()
    result = json.loads((tmp_path / "gpu.json").read_text())
    assert result["machine"]["imaging_device"] == "cuda: Stand-in"
    assert [row["error"] < 1e-3 for row in result["rows"] if "error" in row] == [True, True]
    assert "3-FSK frame" in capsys.readouterr().out


def test_on_a_gpu():
    try:
        array_module("cuda")
    except HandbenchError as error:
        pytest.skip(str(error))
    there, here = on("cuda", image_volume, noise((16, 32, 24)), TONES_HZ, ARRAY, corner(), 1e-3)
    assert relative_error(there, here) < AGREED
