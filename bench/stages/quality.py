"""The quality of a ground truth: the distance of the surface that is reconstructed from fewer or
smaller photographs from the true one."""

import tempfile
from pathlib import Path

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import TRUE_TRANSFORM
from handbench.bench.datasets.simulated import JPEG_QUALITY
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.cameras.cameras import load_cameras, save_cameras
from handbench.groundtruth.dense.kernels import compile_kernels
from handbench.groundtruth.mesh.depth import depth_on_grid, reference_on_grid
from handbench.groundtruth.mesh.mesh_files import raycasting_scene, read_mesh
from handbench.groundtruth.options import Options, Quality
from handbench.groundtruth.photos.photos import Photo, find_photos
from handbench.groundtruth.pipeline import reconstruct
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json
from handbench.support.store import stage

CAMERAS, BOARD = "cameras.json", "board.toml"
QUALITY = "quality.json"
GRID_M = 5e-4  # of the rays that sample both surfaces


def has_quality(capture: Path) -> bool:
    """Tell whether a capture folder has what `measure_quality` needs: photographs, the true surface
    and its transform."""
    data = open_capture(capture)
    return bool(data.photos and data.truth) and (data.folder / TRUE_TRANSFORM).is_file()


def quality_name(views: int, long_px: int, quality: str) -> str:
    """Return the name of a setting in tables, such as "8-views-2400-px-normal"."""
    return f"{views}-views-{long_px}-px-{quality}"


@stage(
    "quality",
    "bench/stages/quality.py",
    "bench/datasets",
    "bench/evaluation",
    "bench/scenes",
    "calibration",
    "groundtruth",
    "radar/data",
    "radar/imaging",
    "radar/simulation",
)
def measure_quality(
    folder: Path, capture: str, views: int, long_px: int, quality: Quality, seed: int
) -> None:
    """Reconstruct a surface from some of a capture's photographs, and write its error and time to
    quality.json in `folder`: surface_rms_mm, observed_percent and seconds.

    Rays along z, GRID_M apart in the radar frame, sample both surfaces. surface_rms_mm is the root
    mean square distance of the reconstructed points from the true surface; observed_percent is the
    reconstructed share of the true points inside the capture's crop box.

    Args:
        folder: receives the file.
        capture: folder of a capture for which `has_quality` holds.
        views: number of photographs, chosen evenly.
        long_px: length of their longer side, to which they are shrunk.
        quality: that of the depth maps.
        seed: of all random choices.

    Raises:
        HandbenchError: the capture has fewer photographs, they are smaller, or their reconstruction
            fails.
    """
    data = open_capture(capture)
    assert data.photos is not None and data.truth is not None
    photos, truth = find_photos(data.photos), read_mesh(data.truth)
    largest_px = max(max(photo.width, photo.height) for photo in photos)
    if views > len(photos) or long_px > largest_px:
        raise HandbenchError(
            f"{data.photos}: has {len(photos)} photographs of {largest_px} pixels, fewer than the "
            f"setting {quality_name(views, long_px, quality)}; correct groundtruth.sweep"
        )
    compile_kernels()  # not timed
    box_m = data.about.box_m
    options = Options(quality=quality, box_m=box_m, seed=seed, dense="cpu")
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        shrink(spread(photos, views), long_px, Path(scratch))
        result = reconstruct(scratch, options)
    radar_from_photo = load_transform(data.folder / TRUE_TRANSFORM)
    ends_m = zip(truth.get_min_bound()[:2], truth.get_max_bound()[:2], strict=True)
    x_m, y_m = (np.arange(low, high, GRID_M) for low, high in ends_m)
    true_z_m = depth_on_grid(truth, x_m, y_m)
    if box_m is not None:
        points_m = np.stack([*np.meshgrid(x_m, y_m), true_z_m], axis=-1)
        in_photo_m = radar_from_photo.inverse().points(points_m.reshape(-1, 3))
        low_m, high_m = np.reshape(box_m, (2, 3))
        inside = ((in_photo_m >= low_m) & (in_photo_m <= high_m)).all(axis=1)
        true_z_m = np.where(inside.reshape(true_z_m.shape), true_z_m, np.nan)
    z_m = reference_on_grid(result.surface.moved(radar_from_photo), x_m, y_m).z_m
    both = np.isfinite(z_m) & np.isfinite(true_z_m)
    if not both.any():
        raise HandbenchError(f"{data.photos}: the reconstruction shows nothing of the true surface")
    points_m = np.stack([*np.meshgrid(x_m, y_m), z_m], axis=-1)[both]
    distance_m = raycasting_scene(truth).compute_distance(points_m.astype(np.float32)).numpy()
    figures = {
        "surface_rms_mm": 1e3 * float(np.sqrt(np.mean(distance_m.astype(float) ** 2))),
        "observed_percent": 100 * float(both.sum() / np.isfinite(true_z_m).sum()),
        "seconds": sum(result.seconds.values()),
    }
    write_json(folder / QUALITY, figures)


def spread(photos: tuple[Photo, ...], count: int) -> tuple[Photo, ...]:
    """Choose `count` of the photographs, evenly spaced in their order. On a rig, this order goes
    around the target."""
    return tuple(photos[i * len(photos) // count] for i in range(count))


def shrink(photos: tuple[Photo, ...], long_px: int, folder: Path) -> None:
    """Write smaller copies of photographs to a folder, with a longer side of at most `long_px`
    pixels. The descriptions beside them are written too: cameras.json, with the intrinsics scaled
    like the photographs, and board.toml."""
    from PIL import Image

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
