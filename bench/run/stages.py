"""The stages of a run: each is one function from files to a folder, and nothing here knows about caching."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench.datasets.dataset import open_capture
from bench.datasets.native import TARGET
from bench.evaluation.depth_errors import deviation_map
from bench.evaluation.metrics import strongest_scatterer_z_m
from bench.results.error_map import ErrorMap
from calibration.alignment import load_alignment
from calibration.array.array_file import ArrayCalibration
from calibration.array.estimate import estimate_array
from calibration.registration.combination import combine
from calibration.registration.register import measure
from calibration.target.description import load_target
from calibration.transforms import Transform, load_transform
from groundtruth.cameras.cameras import Camera
from groundtruth.mesh.depth import Reference, reference_on_grid
from groundtruth.mesh.surface import read_surface
from groundtruth.options import Options
from groundtruth.photos.photos import Photo, find_photos
from groundtruth.pipeline import reconstruct, reconstruct_cloud
from radar.data.capture import RadarCapture, thinned
from radar.data.depthmap import DepthMap
from radar.data.grid import PixelGrid
from radar.methods.registry import Method, Reconstruction, method
from radar.support.config import Config, parse
from radar.support.errors import HandbenchError
from radar.support.files import read_npz, write_json, write_npz
from radar.warmup import compile_kernels

MESH, VIEW = "mesh.ply", "view.jpg"
DEPTH, REPEATS, TIMING = "depth.npz", "repeats.npz", "timing.json"
ALIGNMENT = "alignment.json"
PLANNED_S = 20.0  # what takes longer than any plan is not imaged twice


def make_mesh(capture: Path, quality: str, seed: int, folder: Path) -> None:
    """Photographs → metric mesh in the photo frame (MESH), a photograph cut to the box (VIEW), and what led there.

    All parts of the surface are kept: a hand's own shadow may cut it in two, and the box holds nothing else.
    """
    photos, options = _photos(capture), _options(open_capture(capture).about.box_m, quality, seed)
    result = reconstruct(photos, options, folder / "work")
    result.surface.save(folder / MESH)
    camera = result.cameras[0]
    _write_view(find_photos(photos), camera, options.box(), folder / VIEW)


def _options(box_m: tuple[float, ...] | None, quality: str, seed: int) -> Options:
    values = {"quality": quality, "box_m": box_m, "components": "all", "seed": seed}
    return parse(Options, {**values, "dense": "cpu"}, "groundtruth")  # a table is the same on every machine


def _photos(capture: Path) -> Path:
    """The folder of the capture's photographs."""
    photos = open_capture(capture).photos
    if photos is None:
        raise HandbenchError(f"{capture}: has no folder of photographs; add it, or a mesh")
    return photos


def _write_view(photos: tuple[Photo, ...], camera: Camera, box_m: np.ndarray | None, file: Path) -> None:
    """The camera's photograph, cut to the box [2, 3] in the photo frame."""
    from PIL import Image

    path = next(photo.path for photo in photos if photo.name == camera.name)
    with Image.open(path) as image:
        if box_m is not None:
            corners = camera.project(np.array(list(product(*box_m.T))))
            left, top = np.maximum(corners.min(axis=0), 0)
            right, bottom = np.minimum(corners.max(axis=0), image.size)
            if right - left >= 1 and bottom - top >= 1:
                image = image.crop((left, top, right, bottom))
        image.convert("RGB").save(file, quality=90)


def calibrate_array(captures: Sequence[Path]) -> ArrayCalibration:
    """The array's calibration from the first capture of a target, as recorded."""
    [capture, *_] = captures
    recorded = open_capture(capture)
    return estimate_array(recorded.echoes(calibrated=False), load_target(capture / TARGET), source=recorded.about.name)


def calibrate_captures(
    captures: Sequence[Path], quality: str, seed: int, folder: Path | None = None, array: ArrayCalibration | None = None
) -> Transform:
    """Captures of one target → radar_from_photo; more than one are combined, if the rig stood still between them. The
    photographs' intermediate results go to `folder`, if given. Raises HandbenchError when the targets differ."""
    target = load_target(captures[0] / TARGET)
    measured, names = [], []
    for number, capture in enumerate(captures):
        if load_target(capture / TARGET) != target:
            raise HandbenchError(f"{capture / TARGET}: differs from {captures[0]}'s; combine captures of one target")
        recorded = open_capture(capture)
        names.append(recorded.about.name)
        options = _options(recorded.about.box_m, quality, seed)
        cloud = reconstruct_cloud(_photos(capture), options, folder and folder / str(number))
        echoes = recorded.echoes() if array is None else array.applied_to(recorded.echoes(calibrated=False))
        measured.append(measure(cloud.points_m, cloud.normals, echoes, target, pixel_m=cloud.pixel_m))
    pairs, common_m2 = zip(*measured, strict=True)
    return combine(pairs, False, np.mean(common_m2, axis=0), names, target.ball_offset_sigma_m)


def image_frames(
    capture: Path, method_id: str, config: dict[str, Any], frames: int = 1, every_nth_antenna: int = 1
) -> Iterator[tuple[Reconstruction, float, float | None]]:
    """The first frames of a capture by one method, each with its seconds from echoes in memory to the depth map, and
    with those of the plan, where it was measured.

    The first image of a geometry plans the engine's skeletons, which a radar does once: where that may matter, the
    first frame is imaged again, its second time counts, and what the first took more is the plan's.
    """
    chosen, settings = method(method_id), configuration(capture, method_id, config)
    echoes = thinned(open_capture(capture).echoes(frames), every_nth_antenna)
    if len(echoes.samples) < frames:
        raise HandbenchError(f"{capture}: has {len(echoes.samples)} frames; expected {frames} for the precision")
    compile_kernels()
    for frame in range(frames):
        result, seconds, plan_s = *_timed(chosen, echoes, settings, frame), None
        if frame == 0 and seconds < PLANNED_S:
            first_s = seconds
            result, seconds = _timed(chosen, echoes, settings, frame)
            plan_s = max(first_s - seconds, 0.0)
        yield result, seconds, plan_s


def _timed(chosen: Method, echoes: RadarCapture, settings: Config, frame: int) -> tuple[Reconstruction, float]:
    start = time.perf_counter()
    return chosen.run(echoes, settings, frame), time.perf_counter() - start


def configuration(capture: Path, method_id: str, config: dict[str, Any]) -> Config:
    """The method's configuration for this capture: defaults, then what its sensor asks for, of the method that it is a
    variant of or of itself, then what the user does."""
    of_sensor = open_capture(capture).about.methods
    for known in of_sensor:
        method(known)  # a typing error in capture.toml is not passed over
    chosen = method(method_id)
    asked = {**of_sensor.get(chosen.base, {}), **of_sensor.get(method_id, {})}
    return chosen.configure({**asked, **config}, f"method '{method_id}'")


def make_depth(capture: Path, method_id: str, config: dict[str, Any], folder: Path, every_nth_antenna: int = 1) -> None:
    """Frame 0 → DEPTH, and its time → TIMING."""
    [(result, seconds, plan_s)] = image_frames(capture, method_id, config, 1, every_nth_antenna)
    result.depth.save(folder / DEPTH)
    write_json(folder / TIMING, {"seconds": [seconds], "plan_seconds": plan_s})


def make_repeats(
    capture: Path, method_id: str, config: dict[str, Any], frames: int, folder: Path, every_nth_antenna: int = 1
) -> None:
    """Depth of the strongest scatterer in each frame, and every pixel's deviation over them → REPEATS; the frames'
    times → TIMING."""
    results, seconds, plans_s = zip(*image_frames(capture, method_id, config, frames, every_nth_antenna), strict=True)
    depths = [result.depth for result in results]
    spread = deviation_map(depths[0].x_m, depths[0].y_m, np.stack([d.z_m for d in depths]))
    write_npz(folder / REPEATS, z_m=strongest_z_m(depths), x_m=spread.x_m, y_m=spread.y_m, deviation_m=spread.error_m)
    write_json(folder / TIMING, {"seconds": seconds, "plan_seconds": plans_s[0]})


def strongest_z_m(depths: list[DepthMap]) -> np.ndarray:
    """Depth of the strongest scatterer in each of a capture's repeats: [n]."""
    amplitude = np.stack([10 ** (d.amplitude_db / 20) for d in depths])
    return strongest_scatterer_z_m(np.stack([d.z_m for d in depths]), amplitude)


def reference_depth(mesh_file: Path, radar_from_mesh: Transform, grid: PixelGrid, exact: bool = False) -> Reference:
    """Depth of a mesh file on a pixel grid of the radar, after carrying it into the radar frame; exact: the surface is
    known without error, as a simulator's own is."""
    radar_from_mesh.require(radar_from_mesh.source, "radar", "transform")
    surface = read_surface(mesh_file)
    if exact:
        surface = replace(surface, sigma_m=np.zeros(len(surface.vertices_m)))
        radar_from_mesh = replace(radar_from_mesh, covariance=np.zeros((6, 6)))
    return reference_on_grid(surface.moved(radar_from_mesh), grid.x_m, grid.y_m, radar_from_mesh)


def load_any_transform(file: Path) -> Transform:
    """A transform into the radar frame: our form, or MAROON's in a file of that name, alignment.json."""
    transform = load_alignment(file) if file.name == ALIGNMENT else load_transform(file)
    return transform.require(transform.source, "radar", file)


def read_repeats(folder: Path) -> tuple[np.ndarray, ErrorMap]:
    """What `make_repeats` wrote: the strongest scatterer's depths [n]; every pixel's deviation in place of errors."""
    kept = read_npz(folder / REPEATS, ("z_m", "x_m", "y_m", "deviation_m"))
    return kept["z_m"], ErrorMap(kept["x_m"], kept["y_m"], kept["deviation_m"], kept["deviation_m"])
