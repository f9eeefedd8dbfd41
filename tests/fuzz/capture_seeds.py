"""Small valid inputs of the readers of captures, scenes and benchmarks, each written into an empty
folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomlkit

from tests.fuzz.geometry_seeds import POINTS_M, depth, radar_from_photo, write_obj

if TYPE_CHECKING:
    from handbench.calibration.array.array_file import ArrayCalibration
    from handbench.radar.data.capture import RadarCapture

MATLAB = "hand.mat5"  # no .mat: those who know HDF5 would break it
MAROON = ("hand", "30", "radar_72.0_82.0_2")


def _echoes(tones: int = 3) -> RadarCapture:
    from handbench.radar.data.arrays import AntennaArray
    from handbench.radar.data.capture import RadarCapture

    rng = np.random.default_rng(4)
    samples = rng.standard_normal((1, tones, 2, 3, 2)) @ [1, 1j]
    array = AntennaArray(rng.uniform(-0.1, 0.1, (2, 3)), rng.uniform(-0.1, 0.1, (3, 3)))
    return RadarCapture(samples.astype(np.complex64), np.linspace(72e9, 82e9, tones), array)


def capture(folder: Path) -> None:
    """A capture folder with the calibration of its array."""
    from handbench.bench.datasets.native import ARRAY, ECHOES, CaptureFile, save_capture_file
    from handbench.radar.data.echoes_file import save_capture

    echoes = _echoes()
    save_capture(folder / ECHOES, echoes)
    _save_array(folder / ARRAY, echoes.aperture.tx_m, echoes.aperture.rx_m)
    about = CaptureFile(
        name="hand",
        pose="F",
        distance_m=0.3,
        box_m=(-1, -1, -1, 1, 1, 1),
        contains=(ECHOES,),
        methods={"3fsk": {"x": {"start_m": -0.1, "stop_m": 0.1, "step_m": 0.001}}},
    )
    save_capture_file(folder, about)


def _save_array(path: Path, tx_m: np.ndarray, rx_m: np.ndarray) -> None:
    from handbench.calibration.array.array_file import save_array

    save_array(path, array_calibration(tx_m, rx_m))


def array_calibration(tx_m: np.ndarray, rx_m: np.ndarray) -> ArrayCalibration:
    """The calibration of an array whose antennas all err alike."""
    from handbench.calibration.array.array_file import ArrayCalibration, Side

    def side(places_m: np.ndarray) -> Side:
        n = len(places_m)
        return Side(
            nominal_m=places_m.tolist(),
            gain=[(1.0, 0.1)] * n,
            delay_m=[1e-4] * n,
            offset_m=[(1e-5, 0, 0)] * n,
            level_sigma=[0.01] * n,
            phase_sigma_rad=[0.01] * n,
            delay_sigma_m=[1e-5] * n,
            offset_sigma_m=[(1e-5,) * 3] * n,
        )

    return ArrayCalibration(
        source="target",
        reference_hz=77e9,
        tx=side(tx_m),
        rx=side(rx_m),
        residual_before_db=-10,
        residual_after_db=-30,
    )


def array(folder: Path) -> None:
    """The calibration of an array."""
    _save_array(folder / "array.json", POINTS_M, POINTS_M[:2])


def antennas(folder: Path) -> None:
    """An array's positions."""
    rows = "\n".join(",".join(map(repr, row)) for row in POINTS_M.tolist())
    (folder / "array.csv").write_text(f"x_m,y_m,z_m\n{rows}\n")


def scan(folder: Path) -> None:
    """A planar scan as a capture folder; its samples packed in chunks."""
    import h5py

    from handbench.bench.datasets.native import ECHOES, CaptureFile, save_capture_file
    from handbench.radar.data.arrays import PlanarScan
    from handbench.radar.data.capture import RadarCapture
    from handbench.radar.data.echoes_file import save_capture

    samples = np.ones((2, 3, 4), np.complex64)
    save_capture(
        folder / ECHOES,
        RadarCapture(samples, np.linspace(22e9, 26e9, 3), PlanarScan(np.eye(4)[:, :3])),
    )
    with h5py.File(folder / ECHOES, "r+") as file:
        del file["samples"]
        file.create_dataset(
            "samples", data=samples, chunks=(1, 2, 4), compression="gzip", shuffle=True
        )
    save_capture_file(folder, CaptureFile(name="scan", kind="scan", contains=(ECHOES,)))


def pairs(folder: Path) -> None:
    """A capture of version 2: a list of pairs with gains, swept twice, and the array's calibration
    in the file."""
    import h5py

    from handbench.bench.datasets.native import ECHOES, CaptureFile, save_capture_file

    echoes, listed = _echoes(), [[0, 0], [0, 2], [1, 1], [1, 2]]
    _save_array(folder / "array.json", echoes.aperture.tx_m, echoes.aperture.rx_m)
    with h5py.File(folder / ECHOES, "w") as file:
        file.attrs.update(
            {"format": "handbench-echoes", "version": 2, "units": "m, Hz, m/s", "time": "-jwt"}
        )
        file.attrs.update(
            {
                "frame": "x right, y up, z away",
                "sweeps": "mean",
                "wave_speed_m_s": 2e8,
                "licence": "CC0",
            }
        )
        file["samples"] = np.stack([echoes.samples[:, :, *np.transpose(listed)]] * 2, axis=1)
        file["frequencies_hz"], file["pairs"], file["gains"] = (
            echoes.frequencies_hz,
            listed,
            np.ones(4) + 0.1j,
        )
        file["tx_m"], file["rx_m"] = (
            p * [-1, 1, 1] for p in (echoes.aperture.tx_m, echoes.aperture.rx_m)
        )
        file["array.json"] = np.frombuffer((folder / "array.json").read_bytes(), np.uint8)
    (folder / "array.json").unlink()
    save_capture_file(folder, CaptureFile(name="hand", contains=(ECHOES,)))


def matlab(folder: Path) -> None:
    """A file of MATLAB before 7.3, one variable packed, and its description."""
    from scipy.io import savemat

    mapping(folder)
    echoes, side = _echoes(), [-1, 1, 1]
    told = (folder / "mapping.toml").read_text().replace("set/", "").replace("hand.mat", MATLAB)
    (folder / "mapping.toml").write_text(told)
    (folder / "hand.mat").unlink()
    places = {name: 1e3 * getattr(echoes.aperture, f"{name}_m") * side for name in ("tx", "rx")}
    savemat(folder / MATLAB, {"f": echoes.frequencies_hz / 1e9, **places}, appendmat=False)
    with (folder / MATLAB).open("ab") as stream:
        savemat(stream, {"xr": echoes.samples.conj().T}, do_compression=True)


def mapping(folder: Path) -> None:
    """An HDF5 file as MATLAB writes it, and its description."""
    import h5py

    echoes = _echoes()
    with h5py.File(folder / "hand.mat", "w") as file:
        file["xr"] = np.ascontiguousarray(echoes.samples.conj()).view(
            [("real", "<f4"), ("imag", "<f4")]
        )
        file["set/f"] = echoes.frequencies_hz[:, None] / 1e9
        file["set/tx"], file["set/rx"] = 1e3 * echoes.aperture.tx_m.T, 1e3 * echoes.aperture.rx_m.T
    positions = {"unit": "mm", "reversed": True, "x": "right"}
    (folder / "mapping.toml").write_text(
        tomlkit.dumps(
            {
                "version": 1,
                "file": "hand.mat",
                "capture": {"name": "hand", "distance_m": 0.3},
                "samples": {
                    "dataset": "xr",
                    "axes": ["rx", "tx", "frequency", "frame"],
                    "reversed": True,
                    "sign": "+",
                },
                "frequencies": {"dataset": "set/f", "unit": "GHz"},
                "tx": {"dataset": "set/tx", **positions},
                "rx": {"dataset": "set/rx", **positions},
            }
        )
    )


def maroon(folder: Path) -> None:
    """One object at one distance of MAROON."""
    from handbench.bench.datasets.maroon_alignment import save_alignment
    from handbench.bench.datasets.maroon_frame import Frame
    from handbench.support.files import write_json
    from tests.bench.datasets.maroon_writer import write_frame

    at = folder.joinpath(*MAROON)
    write_frame(
        at / "calibrated_data" / "000000.npy",
        0,
        Frame(np.ones((2, 94, 94)), np.array([72e9, 82e9]), 1),
    )
    volume = {"bb_min": [-0.1, -0.1, 0.25], "bb_max": [0.1, 0.1, 0.4], "grid_size": [21, 21, 16]}
    write_json(at / "calibration.json", {"000000": {"volume": volume}})
    write_json(
        at.parent / "metadata.json",
        {
            "distance_meters": 0.3,
            "mask_erosion": 8,
            "mask_bb": {"zmin": 0.2, "zmax": 0.5},
            "labels": ["hand"],
        },
    )
    save_alignment(at.parent / "alignment.json", radar_from_photo())
    (at.parent / "photogrammetry").mkdir()
    write_obj(at.parent / "photogrammetry" / "mesh_masked.obj")
    depth(folder)


def maroon_sensors(folder: Path) -> None:
    """A Kinect and a RealSense of an object of MAROON."""
    import cv2

    from handbench.calibration.transforms import Transform
    from handbench.support.files import write_json
    from tests.bench.datasets.maroon_writer import KINECT, write_alignment

    matrix = np.diag([1e-3, 1e-3, 1e-3, 1.0])
    others = {name: Transform(name, "radar", matrix) for name in ("kinect", "realsense")}
    write_alignment(folder / "alignment.json", radar_from_photo(), others=others)
    for name, shape, shown in (
        ("kinect", (576, 640), (1080, 1920)),
        ("realsense", (12, 16), (12, 16)),
    ):
        for kind in ("depth", "mask"):
            (folder / name / kind).mkdir(parents=True)
        depth_mm = np.zeros(shape, np.uint16)
        depth_mm[2:10, 3:12] = 300
        cv2.imwrite(str(folder / name / "depth" / "000000.png"), depth_mm)
        cv2.imwrite(str(folder / name / "mask" / "000000.png"), np.full(shown, 255, np.uint8))
    (folder / "kinect" / "calibration.json").write_bytes(KINECT.read_bytes())
    lens = {"fx": 20.0, "fy": 20.0, "cx": 8.0, "cy": 6.0}
    write_json(
        folder / "realsense" / "calibration.json", {"capture": {"scale": 0.001}, "rgb": lens}
    )


def planar_scan(folder: Path) -> None:
    """The six arrays of a raster scan, and its phases."""
    rng = np.random.default_rng(2)
    with (folder / "scan.npy").open("wb") as stream:
        for values in (
            rng.integers(0, 2**16, (2, 3, 4, 5)).astype(np.uint16),
            22.2e9,
            26.2e9,
            3,
            [2e-3, 2e-3],
            0.1,
        ):
            np.save(stream, np.array(values))
    np.savetxt(folder / "phase.txt", [[22.2e9, 24e9, 26.2e9], [0.1, 0.2, -0.3]])


def scene(folder: Path) -> None:
    """A hand on its stand, with every table of a scene file."""
    (folder / "scene.toml").write_text("""
version = 1
name = "F"
seed = 70
effects = "auto"
tolerance_mm = 0.1
[target]
kind = "hand"
pose = "F"
material = { kind = "skin" }
distance_m = 0.31
offset_m = [0.0, -0.03]
rotation_deg = [1.0, 2.0, 3.0]
[sensor]
array = "qar50"
sweep = [{ start_hz = 72e9, stop_hz = 82e9, count = 16 }]
tones_hz = [81.8e9, 79.5e9]
[noise]
[stand]
empty = true
[photos]
cameras = 8
width = 600
[mount]
offset_m = [0.004, -0.006, 0.4]
""")


def benchmark(folder: Path) -> None:
    """A benchmark of one scene by two methods."""
    scene(folder)
    axis = "{ start_m = -0.02, stop_m = 0.02, step_m = 0.002 }"
    (folder / "bench.toml").write_text(f"""
version = 1
name = "small"
seed = 1
repeats = 3
phase_noise_rad = 0.03
[groundtruth]
quality = "draft"
[[capture]]
scene = "scene.toml"
measures = ["accuracy", "precision"]
[[method]]
id = "2fsk"
precision = true
config = {{ x = {axis}, y = {axis} }}
[[method]]
id = "narrowband"
every_nth_antenna = 2
config = {{ x = {axis}, y = {axis}, z = {{ start_m = 0.27, stop_m = 0.29, step_m = 0.002 }} }}
[tradeoff]
repeats = 3
reference = "2fsk-tolerance-1e-2"
[[tradeoff.imaging]]
method = "2fsk"
sweep = {{ tolerance = [1e-2, 1e-3] }}
""")
