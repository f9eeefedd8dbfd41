"""Photographs × their size × quality of the depth maps: how near the measured surface comes to the true one."""

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
from psutil import Process
from pydantic import Field

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import TRUE_TRANSFORM
from handbench.bench.datasets.simulated import JPEG_QUALITY
from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.metrics import pool
from handbench.bench.results import Section, Setting
from handbench.bench.studies.tradeoff.opening import Context, line, section
from handbench.calibration.transforms import Transform, load_transform
from handbench.groundtruth.cameras.cameras import Camera, load_cameras, save_cameras
from handbench.groundtruth.mesh.depth import depth_on_grid, reference_on_grid
from handbench.groundtruth.mesh.mesh_files import raycasting_scene, read_mesh
from handbench.groundtruth.options import Options, Quality
from handbench.groundtruth.photos.photos import FEWEST, Photo, find_photos
from handbench.groundtruth.pipeline import Result, reconstruct
from handbench.support.config import Config
from handbench.support.cost import Cost, measured
from handbench.support.errors import HandbenchError
from handbench.support.progress import say, track
from handbench.support.rays import RaycastingScene, TriangleMesh

CAMERAS, BOARD = "cameras.json", "board.toml"
GRID_M = 5e-4  # of the rays from the radar's side that sample the true surface


class GroundTruthKnobs(Config):
    """views: photographs, evenly out of all; long_px: their longer side, to which they are shrunk (never enlarged);
    quality: of the depth maps, as `handbench groundtruth --quality`."""

    views: tuple[Annotated[int, Field(ge=FEWEST)], ...] = Field(default=(5, 8), min_length=1)
    long_px: tuple[Annotated[int, Field(ge=64)], ...] = Field(default=(1200, 2400), min_length=1)
    quality: tuple[Quality, ...] = Field(default=("draft", "normal"), min_length=1)


@dataclass(frozen=True)
class Subject:
    """The subject of the reconstruction: a capture's photographs, and its true surface, also on a grid of the radar's
    side. z_m [ny, nx]: NaN outside the crop box and beside the surface."""

    name: str
    photos: tuple[Photo, ...]
    box_m: tuple[float, ...] | None
    truth: RaycastingScene
    radar_from_photo: Transform
    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray


def measure(knobs: GroundTruthKnobs, context: Context) -> tuple[Section, list[Setting]] | None:
    """Reconstruct the first capture that has photographs and a known true surface by every setting; None without one.
    A setting that is refused has neither error nor time."""
    subject = next(filter(None, map(_subject, (capture.folder for capture in context.captures))), None)
    if subject is None:
        say(f"tradeoff: groundtruth left out: no capture has photographs, truth.ply and {TRUE_TRANSFORM}")
        return None
    largest_px = max(max(photo.width, photo.height) for photo in subject.photos)
    views = list(dict.fromkeys(min(count, len(subject.photos)) for count in knobs.views))
    sizes_px = list(dict.fromkeys(min(long_px, largest_px) for long_px in knobs.long_px))
    reference = _name(max(views), max(sizes_px), knobs.quality[-1])
    about = section("groundtruth", reference, {"capture": subject.name, "step_mm": 1e3 * GRID_M})
    settings: list[Setting] = []
    for count, long_px in track(list(product(views, sizes_px)), "ground truth"):
        with tempfile.TemporaryDirectory(dir=context.work, prefix=".groundtruth-") as scratch:
            photos = Path(scratch) / "photos"
            shrink(spread(subject.photos, count), long_px, photos)
            if not settings:  # not counted: the first of a machine compiles
                list(_reconstructed(photos, subject, knobs.quality[:1], context.seed, Path(scratch) / "first"))
            made = _reconstructed(photos, subject, knobs.quality, context.seed, Path(scratch) / "work")
            settings += [_setting(about, subject, (count, long_px, *one)) for one in made]
    return about, settings


def _subject(folder: Path) -> Subject | None:
    capture = open_capture(folder)
    true_transform = folder / TRUE_TRANSFORM
    if capture.photos is None or capture.truth is None or not true_transform.is_file():
        return None
    truth, radar_from_photo = read_mesh(capture.truth), load_transform(true_transform)
    box_m = capture.about.box_m
    side = radar_side(truth, radar_from_photo, None if box_m is None else np.reshape(box_m, (2, 3)))
    photos = find_photos(capture.photos)
    return Subject(capture.about.name, photos, box_m, raycasting_scene(truth), radar_from_photo, *side)


def radar_side(
    surface: TriangleMesh, radar_from_photo: Transform, box_m: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The places of the true surface that rays along +z meet first, in the radar frame, one per cell of a grid: x_m
    [nx], y_m [ny], z_m [ny, nx], NaN beside the surface and outside the crop box [2, 3] of the photo frame."""
    low, high = surface.get_min_bound()[:2], surface.get_max_bound()[:2]
    x_m, y_m = (np.arange(a, b, GRID_M) for a, b in zip(low, high, strict=True))
    z_m = depth_on_grid(surface, x_m, y_m)
    if box_m is not None:
        in_photo_m = radar_from_photo.inverse().points(np.stack([*np.meshgrid(x_m, y_m), z_m], -1).reshape(-1, 3))
        inside = ((in_photo_m >= box_m[0]) & (in_photo_m <= box_m[1])).all(axis=1)
        z_m = np.where(inside.reshape(z_m.shape), z_m, np.nan)
    return x_m, y_m, z_m


def spread(photos: tuple[Photo, ...], count: int) -> tuple[Photo, ...]:
    """`count` of the photographs, evenly through their order, which on a rig goes round the target."""
    return tuple(photos[i * len(photos) // count] for i in range(count))


def shrink(photos: tuple[Photo, ...], long_px: int, folder: Path) -> None:
    """Write the photographs, their longer side `long_px` pixels at most, with what lies beside them: their cameras,
    whose intrinsics shrink alike, and the board."""
    from PIL import Image

    folder.mkdir(parents=True)
    beside = photos[0].path.parent
    scales = {photo: min(1.0, long_px / max(photo.width, photo.height)) for photo in photos}
    sizes = {photo.name: (round(scale * photo.width), round(scale * photo.height)) for photo, scale in scales.items()}
    for photo in photos:
        if sizes[photo.name] == (photo.width, photo.height):
            (folder / photo.name).symlink_to(photo.path.resolve())
            continue
        with Image.open(photo.path) as image:
            small = image.convert("RGB").resize(sizes[photo.name], Image.Resampling.LANCZOS)
            small.save(folder / photo.name, quality=JPEG_QUALITY)
    if (beside / CAMERAS).is_file():
        known = [camera for camera in load_cameras(beside / CAMERAS) if camera.name in sizes]
        save_cameras(folder / CAMERAS, tuple(_rescaled(camera, *sizes[camera.name]) for camera in known))
    if (beside / BOARD).is_file():
        (folder / BOARD).symlink_to((beside / BOARD).resolve())


def _rescaled(camera: Camera, width: int, height: int) -> Camera:
    model = camera.colmap()
    model.rescale(width, height)
    return camera.model_copy(update={"width": width, "height": height, "params": tuple(map(float, model.params))})


def _reconstructed(
    photos: Path, subject: Subject, qualities: tuple[str, ...], seed: int, work: Path
) -> Iterator[tuple[str, Result | None, Cost]]:
    """Each quality with its result (None: refused, as is said) and its cost: with the shared cameras' time, and of
    the memory what was added."""
    poses_s = 0.0
    for quality in qualities:
        before_mb = Process().memory_info().rss / 1e6
        options = Options(quality=quality, box_m=subject.box_m, seed=seed, dense="cpu")
        try:
            with measured() as cost:
                result = reconstruct(photos, options, work)
        except HandbenchError as error:
            say(f"tradeoff: groundtruth, {quality}: {error}")
            shutil.rmtree(work, ignore_errors=True)  # poses that nobody has counted
            poses_s = 0.0
            yield quality, None, cost
            continue
        cost.seconds += poses_s
        cost.peak_memory_mb = max(cost.peak_memory_mb - before_mb, 0.0)
        poses_s = result.seconds["sparse"]
        yield quality, result, cost


def _setting(about: Section, subject: Subject, made: tuple[int, int, str, Result | None, Cost]) -> Setting:
    count, long_px, quality, result, cost = made
    title, knobs = f"{count} views, {long_px} px, {quality}", {"views": count, "long_px": long_px, "quality": quality}
    describe = partial(line, about, _name(count, long_px, quality), knobs=knobs)
    if result is None:
        return describe(title=f"{title} (refused)")
    found = compared(result, subject)
    figures = pool([found])
    return describe(
        title=title,
        error=figures["rmse_mm"],
        seconds=[cost.seconds],
        peak_memory_mb=cost.peak_memory_mb,
        seen_percent=figures["observed_percent"],
    )


def compared(result: Result, subject: Subject) -> ErrorMap:
    """Distances of the reconstruction's observed points to the true surface, in place of errors along z."""
    found_m = reference_on_grid(result.surface.moved(subject.radar_from_photo), subject.x_m, subject.y_m).z_m
    points_m = np.stack([*np.meshgrid(subject.x_m, subject.y_m), found_m], axis=-1)
    both = np.isfinite(found_m) & np.isfinite(subject.z_m)
    distance_m = np.full(found_m.shape, np.nan)
    distance_m[both] = subject.truth.compute_distance(points_m[both].astype(np.float32)).numpy()
    return ErrorMap(subject.x_m, subject.y_m, distance_m, subject.z_m)


def _name(count: int, long_px: int, quality: str) -> str:
    return f"{count}-views-{long_px}-px-{quality}"
