"""Small valid inputs of the readers of captures, each written into an empty folder."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import tomlkit

from handbench.bench.datasets.maroon_frame import Frame
from handbench.bench.datasets.native import ARRAY, ECHOES, CaptureFile, save_capture_file
from handbench.calibration.array.array_file import ArrayCalibration, Side, save_array
from handbench.radar.data.arrays import AntennaArray, PlanarScan
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.support.files import write_json
from tests.bench.datasets import test_mapping as foreign
from tests.bench.datasets import test_ti as board
from tests.bench.datasets import test_touchstone as analyser
from tests.bench.datasets.maroon_writer import write_alignment, write_frame
from tests.fuzz.geometry_seeds import depth, meshes, radar_from_photo

MATLAB = "hand.mat5"  # no .mat: those who know HDF5 would break it
SCANNED = Path("hand/30/radar_72.0_82.0_2")


def capture(folder: Path) -> None:
    """A capture folder with the calibration of its array."""
    rng = np.random.default_rng(4)
    samples = (rng.standard_normal((1, 3, 2, 3, 2)) @ [1, 1j]).astype(np.complex64)
    array = AntennaArray(rng.uniform(-0.1, 0.1, (2, 3)), rng.uniform(-0.1, 0.1, (3, 3)))
    save_capture(folder / ECHOES, RadarCapture(samples, np.linspace(72e9, 82e9, 3), array))
    save_array(folder / ARRAY, array_calibration(array.tx_m, array.rx_m))
    about = CaptureFile(
        name="hand",
        pose="F",
        distance_m=0.3,
        box_m=(-1, -1, -1, 1, 1, 1),
        contains=(ECHOES,),
        methods={"3fsk": {"x": {"start_m": -0.1, "stop_m": 0.1, "step_m": 0.001}}},
    )
    save_capture_file(folder, about)


def array_calibration(tx_m: np.ndarray, rx_m: np.ndarray) -> ArrayCalibration:
    """The calibration of an array whose antennas all have the same errors."""

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


def scan(folder: Path) -> None:
    """A planar scan as a capture folder; its samples packed in chunks."""
    samples, tones_hz = np.ones((2, 3, 4), np.complex64), np.linspace(22e9, 26e9, 3)
    save_capture(folder / ECHOES, RadarCapture(samples, tones_hz, PlanarScan(np.eye(4)[:, :3])))
    with h5py.File(folder / ECHOES, "r+") as file:
        del file["samples"]
        packed = {"chunks": (1, 2, 4), "compression": "gzip", "shuffle": True}
        file.create_dataset("samples", data=samples, **packed)
    save_capture_file(folder, CaptureFile(name="scan", kind="scan", contains=(ECHOES,)))


def mapping(folder: Path) -> None:
    """An HDF5 file as MATLAB writes it, and its description."""
    foreign.matlab(folder / "hand.mat")
    (folder / foreign.MAPPING).write_text(tomlkit.dumps(foreign.mapping()))


def matlab(folder: Path) -> None:
    """A packed file of MATLAB before 7.3, and its description."""
    words = tomlkit.dumps(foreign.mapping()).replace("hand.mat", MATLAB)
    (folder / foreign.MAPPING).write_text(words)
    foreign.matlab_7(folder / "hand.mat")
    (folder / "hand.mat").rename(folder / MATLAB)


def maroon(folder: Path) -> None:
    """One object at one distance of MAROON."""
    at = folder / SCANNED
    frame = Frame(np.ones((2, 94, 94)), np.array([72e9, 82e9]), 1)
    write_frame(at / "calibrated_data" / "000000.npy", 0, frame)
    volume = {"bb_min": [-0.1, -0.1, 0.25], "bb_max": [0.1, 0.1, 0.4], "grid_size": [21, 21, 16]}
    write_json(at / "calibration.json", {"000000": {"volume": volume}})
    box = {"zmin": 0.2, "zmax": 0.5}
    about = {"distance_meters": 0.3, "mask_erosion": 8, "mask_bb": box, "labels": ["hand"]}
    write_json(at.parent / "metadata.json", about)
    write_alignment(at.parent / "alignment.json", radar_from_photo())
    (at.parent / "photogrammetry").mkdir()
    meshes(folder)
    (folder / "mesh.obj").rename(at.parent / "photogrammetry" / "mesh_masked.obj")
    depth(folder)


def touchstone(folder: Path) -> None:
    """Four Touchstone files of two ports, with the positions of their antennas."""
    analyser.pairs_of(folder, np.eye(2, 3), -np.eye(2, 3), np.array([0, 0, 0.3]))


def ti_raw(folder: Path) -> None:
    """A TI radar's raw capture with the SDK's profile."""
    board.write(folder, numbers=board.stream(board.counted(2)[0]))
