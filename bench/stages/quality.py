"""The quality of a ground truth: the distance of the surface that is reconstructed from photographs
from the true one."""

from pathlib import Path

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import TRUE_TRANSFORM
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.mesh.depth import reference_on_grid
from handbench.groundtruth.mesh.surface import read_surface
from handbench.groundtruth.options import Options, Quality
from handbench.groundtruth.pipeline import reconstruct
from handbench.support.compiled import clock_s
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json
from handbench.support.rays import embree
from handbench.support.store import stage

QUALITY = "quality.json"
GRID_M = 5e-4  # of the rays that sample both surfaces


def has_quality(capture: Path) -> bool:
    """Tell whether a capture folder has what `measure_quality` needs: photographs, the true surface
    and its transform."""
    data = open_capture(capture)
    return bool(data.photos and data.truth) and (data.folder / TRUE_TRANSFORM).is_file()


def quality_name(quality: Quality) -> str:
    """Return the name of a setting in tables, such as "photographs-normal"."""
    return f"photographs-{quality}"


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
def measure_quality(folder: Path, capture: str, quality: Quality, seed: int) -> None:
    """Reconstruct the surface of a capture's photographs, and write its error and time to
    quality.json in `folder`: surface_rms_mm, observed_percent and seconds.

    Rays along z, GRID_M apart in the radar frame, sample both surfaces. surface_rms_mm is the root
    mean square distance of the reconstructed points from the true surface; observed_percent is the
    reconstructed share of the true points inside the capture's crop box.

    Args:
        folder: receives the file.
        capture: folder of a capture for which `has_quality` holds.
        quality: that of the depth maps.
        seed: of all random choices.

    Raises:
        HandbenchError: the reconstruction fails.
    """
    data = open_capture(capture)
    assert data.photos is not None and data.truth is not None
    truth, box_m = read_surface(data.truth), data.about.box_m
    options = Options(quality=quality, box_m=box_m, seed=seed, dense="cpu")
    start_s = clock_s()
    result = reconstruct(data.photos, options)
    seconds = clock_s() - start_s
    radar_from_photo = load_transform(data.folder / TRUE_TRANSFORM)
    across_m = truth.vertices_m[:, :2].T
    x_m, y_m = (np.arange(axis_m.min(), axis_m.max(), GRID_M) for axis_m in across_m)
    true_z_m = reference_on_grid(truth, x_m, y_m).z_m
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
    rays = embree(truth.vertices_m, truth.faces)
    distance_m = rays.compute_distance(points_m.astype(np.float32)).numpy()
    figures = {
        "surface_rms_mm": 1e3 * float(np.sqrt(np.mean(distance_m.astype(float) ** 2))),
        "observed_percent": 100 * float(both.sum() / np.isfinite(true_z_m).sum()),
        "seconds": seconds,
    }
    write_json(folder / QUALITY, figures)
