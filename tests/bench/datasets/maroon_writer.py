"""A capture written as one object at one distance of MAROON, in the layout that their loaders
open."""

import json
import shutil
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.maroon import (
    EMPTY_FILTERED,
    FRAMES,
    MESHES,
    METADATA,
    PHOTOGRAMMETRY,
    VOLUMES,
)
from handbench.bench.datasets.maroon_alignment import ALIGNMENT, MIRROR_X, kinect_camera
from handbench.bench.datasets.maroon_frame import ANTENNAS, USED, Frame
from handbench.bench.datasets.native import ARRAY, EMPTY, TRUE_TRANSFORM, NativeCapture
from handbench.calibration.array.array_file import with_calibration
from handbench.calibration.transforms import Transform, load_transform
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.cameras.metashape import read_metashape
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import load_capture
from handbench.radar.methods.registry import method
from handbench.support.files import write_json, write_text
from handbench.support.rays import Rays

FRAME_S = 0.1  # between frames
CAMS, KINECT = (
    Path(__file__).with_name(name) for name in ("maroon_cams.xml", "maroon_kinect.json")
)
PHOTO_M, KINECT_M = (
    np.array([0.0, -0.05, 0.0]),
    np.array([0.0, 0.05, 0.0]),
)  # beside the radar's origin
FACING = np.diag([-1.0, -1.0, 1.0])  # camera from radar: x right, y down
BRIGHTEST = 2**16 - 1  # of a maximum projection, which their code keeps as uint16


def write_maroon(
    path: Path, root: Path, exact: bool = False, mirrored: bool = True, kinect: bool = False
) -> Path:
    """Write the capture at `path`, of the 94 + 94 antennas, as ROOT/NAME/CENTIMETRES, and return
    that folder.

    Echoes are multiplied by a power of two that metadata.json has, as large as MAROON's kernels
    take it; exact: by 1. mirrored: x of the radar frame to the right, as their code draws it.
    kinect: with one that sees the true surface. Where the echoes of the empty room are known,
    NNNNNN_emptyfiltered.npy are without them. A simulated capture without a transform gets the true
    one.
    """
    capture = open_capture(path)
    about, echoes = capture.about, capture.echoes()
    assert about.distance_m is not None
    folder = root / about.name / f"{100 * about.distance_m:.0f}"
    low_ghz, high_ghz = echoes.frequencies_hz.min() / 1e9, echoes.frequencies_hz.max() / 1e9
    radar = folder / f"radar_{low_ghz:.1f}_{high_ghz:.1f}_{len(echoes.frequencies_hz)}"
    scale = 1.0 if exact else _scale(echoes.samples)
    _write_frames(radar / FRAMES, replace(echoes, samples=scale * echoes.samples), "")
    empty = capture.folder / EMPTY
    if empty.is_file():
        room, _ = with_calibration(load_capture(empty), capture.folder / ARRAY)
        filtered = replace(echoes, samples=scale * (echoes.samples - room.samples))
        _write_frames(radar / FRAMES, filtered, f"_{EMPTY_FILTERED}")
    write_json(radar / VOLUMES, {f"{0:06d}": {"volume": _volume(capture, mirrored)}})
    box = {"zmin": 0.0, "zmax": 2 * about.distance_m}
    facts = {
        "distance_meters": about.distance_m,
        "mask_erosion": 0,
        "labels": [about.name],
        "mask_bb": box,
    }
    write_json(folder / METADATA, facts | {"handbench_echo_scale": scale})
    _write_surfaces(capture, folder, mirrored, len(echoes.samples) if kinect else 0)
    return folder


def write_frame(file: Path, number: int, frame: Frame) -> None:
    """Write a frame as theirs are; the antennas that are not used get zeros."""
    xr = np.zeros((ANTENNAS, ANTENNAS, len(frame.frequencies_hz)), np.complex64)
    xr[USED, USED] = frame.samples.transpose(2, 1, 0)
    timestamp_us = np.array([round(1e6 * number * FRAME_S)])
    content = {
        "fvec": frame.frequencies_hz.astype(np.float64),
        "xr": xr,
        "number_of_measurements": frame.count,
    }
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("wb") as stream:
        np.save(
            stream,
            np.array({**content, "timestamp_us": timestamp_us}, dtype=object),
            allow_pickle=True,
        )


def _scale(samples: np.ndarray) -> float:
    """The power of two up to which no image, a mean over the channels, is brighter than BRIGHTEST:
    far above the 1e-3 (1 + j) at which each of their 32 threads starts its sum."""
    most = float(np.abs(samples).mean(axis=(2, 3), dtype=np.float64).sum(axis=1).max())
    return float(2.0 ** np.clip(np.floor(np.log2(BRIGHTEST / most)), -99, 99)) if most > 0 else 1.0


def _write_frames(folder: Path, echoes: RadarCapture, suffix: str) -> None:
    for number, samples in enumerate(echoes.samples):
        frame = Frame(samples, echoes.frequencies_hz, len(echoes.samples))
        write_frame(folder / f"{number:06d}{suffix}.npy", number, frame)


def _volume(capture: NativeCapture, mirrored: bool) -> dict[str, list[float]]:
    """The box of the broadband method for this capture, in their frame."""
    chosen = method("broadband")
    grid = chosen.configure(capture.about.methods.get(chosen.id, {}), str(capture.folder)).grid()
    x_m, y_m, z_m = -grid.x_m[::-1] if mirrored else grid.x_m, grid.y_m, grid.z_m
    ends = {
        key: [axis[end] for axis in (x_m, y_m, z_m)] for key, end in (("bb_min", 0), ("bb_max", -1))
    }
    return {**ends, "grid_size": [len(axis) for axis in (x_m, y_m, z_m)]}


def _write_surfaces(
    capture: NativeCapture, folder: Path, mirrored: bool, kinect_frames: int
) -> None:
    """alignment.json; the measured surface, or else the true one, as the meshes that are scored and
    seen by a camera. Where nothing was photographed, the photo frame is the radar's own."""
    measured, true, transform = capture.mesh(), capture.truth, capture.transform()
    file = capture.folder / TRUE_TRANSFORM
    if transform is None and file.exists():
        transform = load_transform(file)
    elif transform is None and measured is None and capture.photos is None:
        transform = Transform("photo", "radar", np.eye(4))
    surfaces = (
        {} if measured is None else dict.fromkeys(("whole", "masked"), read_triangles(measured)[:2])
    )
    if transform is not None:
        others = {}
        if true is not None:
            vertices_m, faces, _ = read_triangles(true)
            carried = transform.inverse().points(vertices_m), faces
            surfaces = surfaces or dict.fromkeys(("whole", "masked"), carried)
            if kinect_frames:
                others["kinect"] = _write_kinect(
                    folder / "kinect", vertices_m, faces, kinect_frames
                )
        write_alignment(folder / ALIGNMENT, transform, mirrored, others)
        if "masked" in surfaces:
            _write_photograph(folder / PHOTOGRAMMETRY, *surfaces["masked"], transform)
    for kind, (vertices_m, faces) in surfaces.items():
        file = folder / PHOTOGRAMMETRY / MESHES[kind]
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("w", encoding="ascii") as stream:
            np.savetxt(stream, vertices_m, "v %.9f %.9f %.9f")  # to a nanometre
            np.savetxt(stream, faces + 1, "f %d %d %d")


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


def _write_photograph(
    folder: Path, vertices: np.ndarray, faces: np.ndarray, radar_from_photo: Transform
) -> None:
    """Write a photograph's camera and depth, in the photo frame and its unit as the mesh [n, 3],
    [m, 3]."""
    R, centre = FACING @ radar_from_photo.rotation, radar_from_photo.inverse().points(PHOTO_M)
    pose = " ".join(f"{number:.12g}" for number in [*np.c_[R.T, centre].ravel(), 0, 0, 0, 1])
    write_text(folder / "cams.xml", CAMS.read_text("utf-8").format(pose=pose))
    [camera] = read_metashape(folder / "cams.xml")
    depth = _seen(camera, Rays(vertices, faces))
    pictures = {
        "rgb/{}.jpg": _shown(depth, 3),
        "mask/{}.png": _shown(depth),
        "depth/{}.tif": depth.astype(np.float32),
    }
    _write(folder, {name.format(camera.name): picture for name, picture in pictures.items()})


def _write_kinect(
    folder: Path, vertices_m: np.ndarray, faces: np.ndarray, frames: int
) -> Transform:
    """Write a Kinect's folder with equal frames of a surface in the radar frame; the transform from
    its depth camera, whose points are millimetres."""
    lines, surface = ["filename device[us] system[ns] absolute[ns]\n"], Rays(vertices_m, faces)
    known = json.loads(KINECT.read_text("utf-8"))["CalibrationInformation"]["Cameras"]
    pose = {"R": FACING, "t": -FACING @ KINECT_M}
    depth_m, colour_m = (
        _seen(kinect_camera(each).model_copy(update=pose), surface) for each in known
    )
    pictures = {
        "depth": np.round(1e3 * depth_m).astype(np.uint16),
        "ir": _shown(depth_m).astype(np.uint16),
    }
    pictures |= {"rgb": _shown(colour_m, 3), "mask": _shown(colour_m)}
    for number in range(frames):
        _write(folder, {f"{kind}/{number:06d}.png": picture for kind, picture in pictures.items()})
        time_ns = round(1e9 * number * FRAME_S)
        lines.append(f"{number:06d} {time_ns // 1000} {time_ns} {time_ns}\n")
    write_text(folder / "timestamps.txt", "".join(lines))
    shutil.copyfile(KINECT, folder / "calibration.json")
    return Transform("kinect", "radar", np.r_[np.c_[1e-3 * FACING.T, KINECT_M], [[0, 0, 0, 1]]])


def _seen(camera: Camera, surface: Rays) -> np.ndarray:
    """Depth along the camera's z [height, width] of what each pixel's centre sees; 0: nothing."""
    rays = camera.ray_directions().reshape(-1, 3)
    distance, _ = surface.first_hits(np.broadcast_to(camera.centre_m, rays.shape), rays)
    return np.where(np.isfinite(distance), distance * (rays @ camera.rotation[2]), 0.0).reshape(
        -1, camera.width
    )


def _shown(depth: np.ndarray, channels: int = 1) -> np.ndarray:
    """White where something is seen: [height, width, channels]."""
    return np.repeat(np.where(depth > 0, 255, 0).astype(np.uint8)[..., None], channels, axis=2)


def _write(folder: Path, pictures: dict[str, np.ndarray]) -> None:
    import cv2

    for name, picture in pictures.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(cv2.imencode(Path(name).suffix, picture)[1].tobytes())
