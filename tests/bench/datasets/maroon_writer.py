"""A capture written as one object at one distance of MAROON, in the layout that their loaders
open."""

import json
import shutil
from itertools import permutations
from pathlib import Path

import cv2
import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.maroon import FRAMES, MESHES, METADATA, PHOTOGRAMMETRY, VOLUMES
from handbench.bench.datasets.maroon_alignment import ALIGNMENT, MIRROR_X, kinect_camera
from handbench.bench.datasets.maroon_frame import ANTENNAS, USED, Frame
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.radar.data.capture import RadarCapture
from handbench.support.files import write_json
from handbench.support.rays import Rays
from tests.bench.datasets.foreign_captures import AXES

KINECT = Path(__file__).with_name("maroon_kinect.json")
KINECT_M = np.array([0.0, 0.05, 0.0])  # beside the radar's origin
FACING = np.diag([-1.0, -1.0, 1.0])  # camera from radar: x right, y down
SCALE = 2.0**14  # of the echoes, which metadata.json has too
RADAR = "radar_72.0_82.0_6"


def write_maroon(path: Path, root: Path, mirrored: bool = True) -> Path:
    """Write the capture at `path`, of the 94 + 94 antennas, as ROOT/patch/30 with a Kinect that
    sees the true surface, and return that folder. mirrored: x of the radar frame to the right, as
    their code draws it. The photo frame is our radar frame."""
    capture, folder = open_capture(path), root / "patch" / "30"
    echoes, true = capture.echoes(), capture.truth
    assert true is not None
    write_radar(folder, echoes, mirrored)
    vertices_m, faces, _ = read_triangles(true)
    kinect = _write_kinect(folder / "kinect", Rays(vertices_m, faces), len(echoes.samples))
    photo = Transform("photo", "radar", np.eye(4))
    write_alignment(folder / ALIGNMENT, photo, mirrored, {"kinect": kinect})
    for name in MESHES.values():
        file = folder / PHOTOGRAMMETRY / name
        file.parent.mkdir(exist_ok=True)
        with file.open("w", encoding="ascii") as stream:
            np.savetxt(stream, vertices_m, "v %.9f %.9f %.9f")  # to a nanometre
            np.savetxt(stream, faces + 1, "f %d %d %d")
    return folder


def write_radar(folder: Path, echoes: RadarCapture, mirrored: bool = True) -> Path:
    """Write what the folder has of the radar alone, and return it."""
    for number, samples in enumerate(echoes.samples):
        frame = Frame(SCALE * samples, echoes.frequencies_hz, len(echoes.samples))
        write_frame(folder / RADAR / FRAMES / f"{number:06d}.npy", number, frame)
    box_m = np.array([[AXES[axis][end] for axis in "xyz"] for end in ("start_m", "stop_m")])
    if mirrored:
        box_m[:, 0] = -box_m[::-1, 0]
    volume = dict(zip(("bb_min", "bb_max"), box_m.tolist(), strict=True)) | {"grid_size": [11] * 3}
    write_json(folder / RADAR / VOLUMES, {"000000": {"volume": volume}})
    box = {"zmin": 0.0, "zmax": 0.6}
    facts = {"distance_meters": 0.3, "mask_erosion": 0, "labels": ["patch"], "mask_bb": box}
    write_json(folder / METADATA, facts | {"handbench_echo_scale": SCALE})
    return folder


def write_frame(file: Path, number: int, frame: Frame) -> None:
    """Write a frame as theirs are; the antennas that are not used get zeros."""
    xr = np.zeros((ANTENNAS, ANTENNAS, len(frame.frequencies_hz)), np.complex64)
    xr[USED, USED] = frame.samples.transpose(2, 1, 0)
    content = {
        "fvec": frame.frequencies_hz.astype(np.float64),
        "xr": xr,
        "number_of_measurements": frame.count,
        "timestamp_us": np.array([100_000 * number]),
    }
    file.parent.mkdir(parents=True, exist_ok=True)
    np.save(file, np.array(content, dtype=object), allow_pickle=True)


def write_alignment(
    file: Path,
    transform: Transform,
    mirrored: bool = True,
    others: dict[str, Transform] | None = None,
) -> None:
    """alignment.json with every way between the photographs' frame, those of the other sensors, the
    radar's and the world, which is the radar's."""
    flip = MIRROR_X if mirrored else np.eye(4)
    sensors = {"photogrammetry": transform, **(others or {})}
    to_radar = {name: flip @ of.matrix for name, of in sensors.items()} | {"radar": np.eye(4)}
    from_radar = {name: np.linalg.inv(matrix) for name, matrix in to_radar.items()}
    between = {f"{a}2{b}": from_radar[b] @ to_radar[a] for a, b in permutations(to_radar, 2)}
    world = {f"{name}2world": matrix for name, matrix in to_radar.items()}
    write_json(file, {"kinect_calib": {"space": "depth"}} | between | world)


def _write_kinect(folder: Path, surface: Rays, frames: int) -> Transform:
    """Write a Kinect's folder with equal frames of a surface in the radar frame; the transform from
    its depth camera, whose points are millimetres."""
    known = json.loads(KINECT.read_text("utf-8"))["CalibrationInformation"]["Cameras"]
    depth_m, colour_m = (_seen_m(each, surface) for each in known)
    pictures = {"depth": (1e3 * depth_m).round().astype(np.uint16)}
    pictures["mask"] = np.where(colour_m > 0, 255, 0).astype(np.uint8)
    for kind, picture in pictures.items():
        (folder / kind).mkdir(parents=True)
        for number in range(frames):
            cv2.imwrite(str(folder / kind / f"{number:06d}.png"), picture)
    shutil.copyfile(KINECT, folder / "calibration.json")
    return Transform("kinect", "radar", np.r_[np.c_[1e-3 * FACING.T, KINECT_M], [[0, 0, 0, 1]]])


def _seen_m(factory: dict, surface: Rays) -> np.ndarray:
    """Depth along the camera's z [height, width] of what each pixel's centre sees; 0: nothing."""
    pose = {"R": FACING, "t": -FACING @ KINECT_M}
    camera = kinect_camera(factory).model_copy(update=pose)
    rays = camera.ray_directions().reshape(-1, 3)
    distance, _ = surface.first_hits(np.broadcast_to(camera.centre_m, rays.shape), rays)
    z_m = np.where(np.isfinite(distance), distance * (rays @ camera.rotation[2]), 0.0)
    return z_m.reshape(-1, camera.width)
