"""A capture written as one object at one distance of MAROON, in the layout that their loaders
open."""

from pathlib import Path

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.maroon import FRAMES, MESHES, METADATA, PHOTOGRAMMETRY, VOLUMES
from handbench.bench.datasets.maroon_alignment import ALIGNMENT, KEY, MIRROR_X
from handbench.bench.datasets.maroon_frame import ANTENNAS, USED
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.support.files import write_json
from tests.bench.datasets.foreign_captures import AXES

RADAR = "radar_72.0_82.0_6"


def write_maroon(path: Path, root: Path, mirrored: bool = True) -> Path:
    """Write the capture at `path`, of the 94 + 94 antennas, as ROOT/patch/30, and return that
    folder. mirrored: x of the radar frame to the right, as their code draws it. The photo frame is
    our radar frame."""
    capture, folder = open_capture(path), root / "patch" / "30"
    echoes = capture.echoes()
    for number, samples in enumerate(echoes.samples):
        file = folder / RADAR / FRAMES / f"{number:06d}.npy"
        write_frame(file, number, samples, echoes.frequencies_hz)
    box_m = np.array([[AXES[axis][end] for axis in "xyz"] for end in ("start_m", "stop_m")])
    if mirrored:
        box_m[:, 0] = -box_m[::-1, 0]
    volume = dict(zip(("bb_min", "bb_max"), box_m.tolist(), strict=True)) | {"grid_size": [11] * 3}
    write_json(folder / RADAR / VOLUMES, {"000000": {"volume": volume}})
    box = {"zmin": 0.0, "zmax": 0.6}
    facts = {"distance_meters": 0.3, "mask_erosion": 0, "labels": ["patch"], "mask_bb": box}
    write_json(folder / METADATA, facts)
    write_alignment(folder / ALIGNMENT, Transform("photo", "radar", np.eye(4)), mirrored)
    vertices_m, faces, _ = read_triangles(capture.truth)
    for name in MESHES:
        file = folder / PHOTOGRAMMETRY / name
        file.parent.mkdir(exist_ok=True)
        with file.open("w", encoding="ascii") as stream:
            np.savetxt(stream, vertices_m, "v %.9f %.9f %.9f")  # to a nanometre
            np.savetxt(stream, faces + 1, "f %d %d %d")
    return folder


def write_frame(file: Path, number: int, samples: np.ndarray, tones_hz: np.ndarray) -> None:
    """Write a frame as theirs are; the antennas that are not used get zeros."""
    xr = np.zeros((ANTENNAS, ANTENNAS, len(tones_hz)), np.complex64)
    xr[USED, USED] = samples.transpose(2, 1, 0)
    content = {
        "fvec": tones_hz.astype(np.float64),
        "xr": xr,
        "number_of_measurements": np.int64(2),
        "timestamp_us": np.array([100_000 * number]),
    }
    file.parent.mkdir(parents=True, exist_ok=True)
    np.save(file, np.array(content, dtype=object), allow_pickle=True)


def write_alignment(file: Path, transform: Transform, mirrored: bool = True) -> None:
    """Write alignment.json with the matrices between the photographs' frame and the radar's."""
    matrix = MIRROR_X @ transform.matrix if mirrored else transform.matrix
    inverse = np.linalg.inv(matrix)
    write_json(file, {KEY: matrix.ravel().tolist(), "radar2photogrammetry": inverse.tolist()})
