"""The trade-off's section on ground truth: photogrammetry with different numbers of photographs,
sizes of photographs and qualities of depth maps. The error is the distance of the reconstructed
surface from the true one."""

import tempfile
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import TRUE_TRANSFORM
from handbench.bench.datasets.simulated import JPEG_QUALITY
from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.metrics import pool
from handbench.bench.results import Failure
from handbench.bench.run.outcome import recorded_failure
from handbench.bench.tradeoff.settings import (
    MeasuredSection,
    TradeoffInputs,
    added_memory,
    in_rounds,
    line,
    section,
)
from handbench.calibration.transforms import Transform, load_transform
from handbench.groundtruth.cameras.cameras import load_cameras, save_cameras
from handbench.groundtruth.dense.kernels import compile_kernels
from handbench.groundtruth.mesh.depth import depth_on_grid, reference_on_grid
from handbench.groundtruth.mesh.mesh_files import raycasting_scene, read_mesh
from handbench.groundtruth.mesh.surface import Surface
from handbench.groundtruth.options import Options
from handbench.groundtruth.photos.photos import Photo, find_photos
from handbench.groundtruth.pipeline import reconstruct
from handbench.support.errors import HandbenchError
from handbench.support.rays import RaycastingScene, TriangleMesh

CAMERAS, BOARD = "cameras.json", "board.toml"
GRID_M = 5e-4  # of the rays from the radar's side that sample the true surface
VARIED, NAME = ("views", "long_px", "quality"), "{views}-views-{long_px}-px-{quality}"
TITLE = "{views} views, {long_px} px, {quality}"
Grid = tuple[np.ndarray, np.ndarray, np.ndarray]  # x_m [nx], y_m [ny], z_m [ny, nx]


def measure_groundtruth(inputs: TradeoffInputs) -> MeasuredSection:
    """Reconstruct a surface from photographs by every setting of the sweep, and measure its
    distance from the true surface, and the time.

    The first capture with photographs and a true surface is used. A setting whose reconstruction
    fails has neither error nor time. Settings that differ only in quality share the cameras' poses,
    whose time counts for each of them. Raises HandbenchError if there is no such capture.
    """
    for recorded in (open_capture(each.folder) for each in inputs.captures):
        pictures, surface, transform = (
            recorded.photos,
            recorded.truth,
            recorded.folder / TRUE_TRANSFORM,
        )
        if pictures and surface and transform.is_file():
            break
    else:
        raise HandbenchError(
            f"no capture has photographs, truth.ply and {TRUE_TRANSFORM}, which this section "
            "needs; add such a capture, or leave the section out"
        )
    truth, radar_from_photo, photos = (
        read_mesh(surface),
        load_transform(transform),
        find_photos(pictures),
    )
    capture, box_m = recorded.about.name, recorded.about.box_m
    side = radar_side(truth, radar_from_photo, None if box_m is None else np.reshape(box_m, (2, 3)))
    target, knobs = raycasting_scene(truth), inputs.sweep.groundtruth
    largest_px = max(max(photo.width, photo.height) for photo in photos)
    views = dict.fromkeys(min(count, len(photos)) for count in knobs.views)
    sizes_px = dict.fromkeys(min(long_px, largest_px) for long_px in knobs.long_px)
    every = (
        dict(zip(VARIED, values, strict=True)) for values in product(views, sizes_px, knobs.quality)
    )
    choices = {NAME.format(**choice): choice for choice in every}
    compile_kernels()  # not counted
    with tempfile.TemporaryDirectory(dir=inputs.work, prefix=".groundtruth-") as scratch:

        def reconstructed(choice: dict[str, Any]) -> Iterator[dict[str, Any]]:
            folder, failures = Path(scratch) / "{views}-{long_px}".format(**choice), list[Failure]()
            if not folder.exists():
                shrink(spread(photos, choice["views"]), choice["long_px"], folder)
            with (
                recorded_failure(failures, capture, "groundtruth", NAME.format(**choice)),
                added_memory() as cost,
            ):
                options = Options(
                    quality=choice["quality"], box_m=box_m, seed=inputs.bench.seed, dense="cpu"
                )
                result = reconstruct(folder, options, folder.with_suffix(".work"))
            if not failures:
                figures = pool([distances(result.surface.moved(radar_from_photo), target, side)])
                yield {
                    "error": figures["rmse_mm"],
                    "seen_percent": figures["observed_percent"],
                    "seconds": sum(result.seconds.values()),
                    "peak_memory_mb": cost.peak_memory_mb,
                }

        found = in_rounds(
            choices, 1, reconstructed, "ground truth", inputs.predicted_s.get("groundtruth", 0.0)
        )
    reference = NAME.format(views=max(views), long_px=max(sizes_px), quality=knobs.quality[-1])
    about = section("groundtruth", reference, {"capture": capture, "step_mm": 1e3 * GRID_M})
    lines = []
    for name, choice in choices.items():
        title = TITLE.format(**choice) + ("" if found[name] else " (refused)")
        figures = {
            key: value for made in found[name] for key, value in made.items() if key != "round"
        }
        seconds = [figures.pop("seconds")] if figures else []
        lines.append(line(about, name, title, choice, seconds=seconds, **figures))
    return MeasuredSection(about, lines)


def radar_side(
    surface: TriangleMesh, radar_from_photo: Transform, box_m: np.ndarray | None
) -> Grid:
    """Sample the side of the true surface that the radar sees, by rays along +z with a spacing of
    GRID_M.

    Returns x_m [nx], y_m [ny] and the depth z_m [ny, nx] at which each ray first meets the surface,
    in the radar frame. z_m is NaN where a ray misses the surface, and outside the crop box box_m
    [2, 3] (least and largest corner in the photo frame; None: no box).
    """
    low, high = surface.get_min_bound()[:2], surface.get_max_bound()[:2]
    x_m, y_m = (np.arange(a, b, GRID_M) for a, b in zip(low, high, strict=True))
    z_m = depth_on_grid(surface, x_m, y_m)
    if box_m is not None:
        in_photo_m = radar_from_photo.inverse().points(
            np.stack([*np.meshgrid(x_m, y_m), z_m], -1).reshape(-1, 3)
        )
        inside = ((in_photo_m >= box_m[0]) & (in_photo_m <= box_m[1])).all(axis=1)
        z_m = np.where(inside.reshape(z_m.shape), z_m, np.nan)
    return x_m, y_m, z_m


def spread(photos: tuple[Photo, ...], count: int) -> tuple[Photo, ...]:
    """Choose `count` of the photographs, evenly spaced in their order. On a rig, this order goes
    around the target."""
    return tuple(photos[i * len(photos) // count] for i in range(count))


def shrink(photos: tuple[Photo, ...], long_px: int, folder: Path) -> None:
    """Write smaller copies of photographs to a folder, with a longer side of at most `long_px`
    pixels. The descriptions beside them are written too: cameras.json, with the intrinsics scaled
    like the photographs, and board.toml."""
    from PIL import Image

    folder.mkdir(parents=True)
    source, sizes = photos[0].path.parent, {}
    for photo in photos:
        scale = min(1.0, long_px / max(photo.width, photo.height))
        sizes[photo.name] = size = round(scale * photo.width), round(scale * photo.height)
        if scale == 1:
            (folder / photo.name).symlink_to(photo.path.resolve())
            continue
        with Image.open(photo.path) as image:
            small = image.convert("RGB").resize(size, Image.Resampling.LANCZOS)
            small.save(folder / photo.name, quality=JPEG_QUALITY)
    if (source / CAMERAS).is_file():
        cameras = []
        for camera in (camera for camera in load_cameras(source / CAMERAS) if camera.name in sizes):
            model, (width, height) = camera.colmap(), sizes[camera.name]
            model.rescale(width, height)
            params = tuple(map(float, model.params))
            cameras.append(
                camera.model_copy(update={"width": width, "height": height, "params": params})
            )
        save_cameras(folder / CAMERAS, tuple(cameras))
    if (source / BOARD).is_file():
        (folder / BOARD).symlink_to((source / BOARD).resolve())


def distances(surface: Surface, truth: RaycastingScene, side: Grid) -> ErrorMap:
    """Compute the distances of a reconstructed surface's points from the true surface, metres: an
    `ErrorMap` with these in error_m.

    surface: the reconstruction, radar frame. truth: the true surface, for distances. side: grid of
    points where the radar sees the true surface, from `radar_side`.
    """
    x_m, y_m, z_m = side
    found_m = reference_on_grid(surface, x_m, y_m).z_m
    points_m = np.stack([*np.meshgrid(x_m, y_m), found_m], axis=-1)
    both = np.isfinite(found_m) & np.isfinite(z_m)
    distance_m = np.full(found_m.shape, np.nan)
    distance_m[both] = truth.compute_distance(points_m[both].astype(np.float32)).numpy()
    return ErrorMap(x_m, y_m, distance_m, z_m)
