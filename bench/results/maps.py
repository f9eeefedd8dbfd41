"""Reading and writing of the depth maps, error maps and photographs of a result folder, and their
paths; and the depth map of a mesh as its sensor sees it."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.groundtruth.mesh.depth import reference_on_grid
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.depthmap import LARGEST
from handbench.radar.data.grid import bounding_box
from handbench.support.config import checked_name
from handbench.support.errors import HandbenchError
from handbench.support.files import ARRAY_BYTES, read_npz, write_npz

VIEWED_PX = 320  # along each side


@dataclass(frozen=True)
class SurfaceMap:
    """A depth map for drawing: z_m [ny, nx] at the pixel centres x_m [nx], y_m [ny], metres; NaN
    where there is no surface.
    sigma_m [ny, nx]: for a reference, the standard deviation along z of mesh and registration
    together (None: not given; NaN: unknown)."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    sigma_m: np.ndarray | None = None


@dataclass(frozen=True)
class Frames:
    """Depths and radial velocities of a sequence, for drawing: z_m, velocity_m_s [frame, ny, nx],
    metres and m/s, NaN off target, at the pixel centres x_m [nx], y_m [ny]; times_s [frame]: start
    of each frame."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    velocity_m_s: np.ndarray
    times_s: np.ndarray


def errors_path(folder: Path, capture: str, method: str, reference: str) -> Path:
    """Return the path of the error map of a capture, method and reference in a result folder.
    Raises HandbenchError for a name that cannot be part of a file name."""
    return _path(folder / "errors", ".npz", capture, method, reference)


def depth_path(folder: Path, capture: str, source: str) -> Path:
    """Return the path of a capture's depth map in a result folder.
    source: a method or a reference. Raises HandbenchError for a name that cannot be part of a file
    name."""
    return _path(folder / "depth", ".npz", capture, source)


def frames_path(folder: Path, capture: str, method: str) -> Path:
    """Return the path of the depths and velocities of all frames of a capture in a result
    folder."""
    return _path(folder / "frames", ".npz", capture, method)


def photo_path(folder: Path, capture: str) -> Path:
    """Return the path of a capture's small photograph in a result folder."""
    return _path(folder / "photos", ".jpg", capture)


def _path(folder: Path, suffix: str, *names: str) -> Path:
    try:
        return folder / ("__".join(map(checked_name, names)) + suffix)
    except ValueError as error:
        raise HandbenchError(f"{folder}: {error}") from None


def write_errors(folder: Path, capture: str, method: str, reference: str, errors: ErrorMap) -> None:
    """Write the error map of one capture, method and reference into a result folder."""
    write_npz(errors_path(folder, capture, method, reference), **_arrays(errors))


def write_surface(folder: Path, capture: str, reference: str, surface: SurfaceMap) -> None:
    """Write the depth map of a reference into a result folder. (A method's map is written by
    `DepthMap.save`.)"""
    write_npz(depth_path(folder, capture, reference), **_arrays(surface))


def write_frames(folder: Path, capture: str, method: str, frames: Frames) -> None:
    """Write the depths and velocities of all frames of a capture into a result folder, unless they
    are larger than a reader accepts."""
    seen = np.isfinite(frames.z_m).any(axis=0)
    y, x = bounding_box(seen) if seen.any() else (slice(0), slice(0))
    kept = vars(frames)
    if min(seen[y, x].shape) >= 2:
        kept = kept | {"x_m": frames.x_m[x], "y_m": frames.y_m[y]}
        kept |= {name: kept[name][:, y, x] for name in ("z_m", "velocity_m_s")}
    if sum(values.nbytes for values in kept.values()) < ARRAY_BYTES:
        write_npz(frames_path(folder, capture, method), **kept)


def read_frames(folder: Path, capture: str, method: str) -> Frames | None:
    """Read the depths and velocities of all frames of a capture from a result folder; None if it
    has none. Raises HandbenchError as `read_map` does."""
    path = frames_path(folder, capture, method)
    return Frames(**read_map(path, "times_s", "z_m", "velocity_m_s")) if path.is_file() else None


def _arrays(maps: SurfaceMap | ErrorMap) -> dict[str, np.ndarray]:
    return {name: values for name, values in vars(maps).items() if values is not None}


def read_errors(folder: Path, capture: str, method: str, reference: str) -> ErrorMap:
    """Read the error map of one capture, method and reference from a result folder."""
    path = errors_path(folder, capture, method, reference)
    others = ("sigma_m", "to_reference_m", "to_map_m")
    return ErrorMap(**read_map(path, "error_m", "reference_z_m", optional=others))


def read_map(path: Path, *names: str, optional: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """Read and check a file with a depth map, an error map or frames: name → array, including x_m
    [nx] and y_m [ny].
    names: arrays that the file must have, [ny, nx], or with times_s [frame] among them
    [frame, ny, nx]; optional: arrays that are read if present. Raises HandbenchError for arrays of
    another shape or type, values that are too large (LARGEST), and positions that repeat or are
    no numbers."""
    arrays = read_npz(path, ("x_m", "y_m", *names), optional)
    axes = [name for name in ("times_s", "y_m", "x_m") if name in arrays]
    shape = tuple(arrays[name].size for name in axes)
    for name, array in arrays.items():
        expected = (array.size,) if name in axes else shape
        if array.shape != expected or array.dtype.kind != "f" or min(shape[-2:]) < 2:
            raise HandbenchError(
                f"{path}: '{name}' is {array.dtype} {array.shape}; expected real numbers "
                f"{expected} on a grid of at least 2 × 2; run the benchmark again"
            )
        position = name in ("x_m", "y_m")
        if (np.abs(array) > LARGEST).any() or (position and not np.abs(np.diff(array)).min() > 0):
            raise HandbenchError(
                f"{path}: '{name}' has values beyond {LARGEST:g}, or positions that repeat or "
                "are no numbers; run the benchmark again"
            )
    return arrays


def view(mesh: Surface) -> tuple[str, SurfaceMap]:
    """Return the sensor that saw a mesh, array or cameras, and the mesh's depths from there; with
    their standard deviations, if the mesh was made from photographs. A mesh without scale is drawn
    one metre long, without standard deviations."""
    sensor, signs = _seen_from(mesh)
    longest = 1.0 if mesh.scaled else np.ptp(mesh.vertices_m, axis=0).max()
    turned = replace(mesh, vertices_m=mesh.vertices_m * signs / longest)
    low_m, high_m = turned.vertices_m.min(axis=0), turned.vertices_m.max(axis=0)
    x_m, y_m, _ = np.linspace(low_m, high_m, VIEWED_PX).T
    depth = reference_on_grid(turned, x_m, y_m)
    sigma_m = depth.mesh_sigma_m if sensor == "cameras" and mesh.scaled else None
    return sensor, SurfaceMap(x_m, y_m, depth.z_m, sigma_m)


def _seen_from(mesh: Surface) -> tuple[str, np.ndarray]:
    """Find from which side a mesh must be drawn: returns the sensor, and signs of x, y and z with
    which the axes point left, up and away from it.
    A mesh with sigma_m was made from photographs. If its observed faces point towards +z, its frame
    is that of a board, with the cameras on the side of +z. Otherwise it is a camera's frame (x
    right, y down, z away from the camera)."""
    if not np.isfinite(mesh.sigma_m).any():
        return "array", np.ones(3)
    seen = mesh.faces[mesh.observed[mesh.faces].all(axis=1)]
    a, b, c = np.moveaxis(mesh.vertices_m[seen], 1, 0)
    facing = np.cross(b - a, c - a)[:, 2].sum() >= 0
    return "cameras", np.array([-1, 1, -1] if facing else [-1, -1, 1])
