"""`alignment.json`, the file of transforms of the MAROON data set (Wirth et al. 2024, arXiv 2411.00527).

It holds 4×4 matrices in row order under `SOURCE2DEST`, applied to columns [p, 1], between the frames of the sensors
`radar`, `photogrammetry`, `kinect`, `realsense`, `zed` and a common `world`; metres in the first two, millimetres in
the cameras' frames. Their code draws a left-handed radar frame, x to the right, y up, z away, so that p_ours =
diag(−1, 1, 1)·p_theirs, and a matrix from a right-handed sensor contains a reflection. One without says that the radar
frame is ours already, or that the sensor's points are a mirror image. Both readings place what the sensor saw before
the radar, one mirrored in x, and the radar's own depth tells them apart. The evidence stands in docs/maroon.md.
"""

from collections.abc import Callable, Mapping
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from handbench.calibration.transforms import Transform, checked_numbers, identity, load_transform
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.mesh_files import mesh
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json
from handbench.support.limits import RAW_JSON_BYTES, RAW_VALUES
from handbench.support.progress import say

ALIGNMENT = "alignment.json"
ROUNDING, TOO_CROOKED = 1e-6, 1e-3  # largest element by which a matrix may miss its rotation: unsaid, and at all
FARTHEST_M = 10.0  # no two sensors of the set-up stand further apart; more are millimetres
MIRROR_X = np.diag([-1.0, 1.0, 1.0, 1.0])
FRAMES = {"photogrammetry": "photo"}  # ours for theirs; the others keep their names
PIXELS = {"start_m": -0.15, "stop_m": 0.15, "step_m": 0.003}  # about x = 0
LOOK = {"x": PIXELS, "y": PIXELS, "coarse_filter_px": 3, "fine_filter_px": 1}  # 3-FSK, a ninth of the paper's pixels
FAR_MM = 20.0  # off the nearer reading the radar's depth is of something else
CLEAR_MM = 0.5  # by which the reading that the matrix does not suggest must fit better; below, the object is symmetric
Triangles = tuple[np.ndarray, np.ndarray]  # vertices [n, 3] and faces [m, 3]


def load_alignment(path: str | Path, source: str = "photogrammetry", mirrored: bool | None = None) -> Transform:
    """`radar_from_SOURCE` in our radar frame, metres; it carries no covariance. `photogrammetry` becomes our `photo`.

    source: a sensor of the file; its points are in the unit that the file's matrix expects (see above), which the
    transform's scale shows. mirrored: whether the file's radar frame has x to the right; None: if the matrix contains a
    reflection. Asked for the other reading, the source is a mirror image, and the transform's scale negative. The
    matrix is brought to the nearest rotation with a scale. Raises HandbenchError for anything but a finite 4×4
    similarity, and for an unknown source.
    """
    content = read_table(path)
    key = f"{source}2radar"
    if key not in content:
        known = [name.removesuffix("2radar") for name in content if name.endswith("2radar")]
        raise HandbenchError(f"{path}: has no '{key}'; {suggest(source, known)}")
    matrix = checked_numbers(path, key, content[key], [(4, 4), (16,)]).reshape(4, 4)
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > ROUNDING:
        raise HandbenchError(f"{path}: the last row of '{key}' is {matrix[3].tolist()}; expected [0, 0, 0, 1]")
    if np.linalg.norm(matrix[:3, 3]) > FARTHEST_M:
        raise HandbenchError(
            f"{path}: '{key}' shifts by {np.linalg.norm(matrix[:3, 3]):.4g} m; expected metres, {FARTHEST_M:g} at most"
        )
    reflects = bool(np.linalg.det(matrix[:3, :3]) < 0)
    flip = MIRROR_X if (reflects if mirrored is None else mirrored) else np.eye(4)
    return Transform(FRAMES.get(source, source), "radar", _straight(path, key, flip @ matrix))


def save_alignment(
    path: str | Path, transform: Transform, mirrored: bool | None = None, others: Mapping[str, Transform] | None = None
) -> None:
    """Write `radar_from_photo` in MAROON's form, atomically, and `radar_from_SENSOR` of the others: between each two of
    them and the radar, and into the world, which is the radar's frame in a new file.

    An existing file keeps its other keys, and the hand of its radar frame; mirrored: the hand of a new one, None: x to
    the right, as their code draws it. The covariance has no place there.
    """
    transform.require("photo", "radar", "transform")
    known: dict[str, Any] = {"radar2world": np.eye(4), "kinect_calib": {"space": "depth"}}  # which no viewer corrects
    if Path(path).exists():
        known |= read_table(path)
        if mirrored is None and "photogrammetry2radar" in known:
            mirrored = load_alignment(path, mirrored=True).scale > 0
    flip = np.eye(4) if mirrored is False else MIRROR_X  # from our radar frame to theirs, or back
    sensors = {"photogrammetry": transform, **(others or {})}
    to_radar = {name: flip @ of.matrix for name, of in sensors.items()} | {"radar": np.eye(4)}
    world = checked_numbers(path, "radar2world", known["radar2world"], [(4, 4), (16,)]).reshape(4, 4)
    from_radar = {name: of.inverse().matrix @ flip for name, of in sensors.items()} | {"radar": np.eye(4)}
    between = {f"{a}2{b}": from_radar[b] @ to_radar[a] for a, b in permutations(to_radar, 2)}
    write_json(path, known | between | {f"{name}2world": world @ to_radar[name] for name in sensors})


def read_table(path: str | Path, what: str = "MAROON's alignment.json") -> dict[str, Any]:
    """One of MAROON's JSON files, which hold a table; anything else, or a larger one, is a HandbenchError."""
    content = read_json(path, what, RAW_VALUES, RAW_JSON_BYTES)  # it also holds intermediate data of the calibration
    if not isinstance(content, dict):
        raise HandbenchError(f"{path}: holds no table of transforms or facts; expected {what}")
    return content


def _straight(path: str | Path, key: str, matrix: np.ndarray) -> np.ndarray:
    """The matrix with the nearest rotation or reflection (polar decomposition) and the mean stretch as scale; says how
    far it was."""
    u, stretch, vt = np.linalg.svd(matrix[:3, :3])
    scale, rotation = float(stretch.mean()), u @ vt
    crooked = float(np.abs(matrix[:3, :3] / scale - rotation).max()) if scale > 0 else np.inf
    if crooked > TOO_CROOKED:
        raise HandbenchError(
            f"{path}: '{key}' is {crooked:.2g} off a rotation with one scale; expected {TOO_CROOKED:g} at most"
        )
    if crooked > ROUNDING:
        say(f"{path}: '{key}' was {crooked:.1e} off a rotation; the nearest one is taken")
    straight = matrix.copy()
    straight[:3, :3] = scale * rotation
    straight[3] = [0, 0, 0, 1]
    return straight


class Handedness(NamedTuple):
    """mirrored: their x is ours negated; note: how it was found, in words."""

    mirrored: bool
    note: str


def handedness_of(
    path: Path, source: str, surface: Callable[[], Triangles] | None, echoes: Callable[[], RadarCapture]
) -> Handedness:
    """Handedness of an alignment file, said. surface: what `source` saw, in its frame; None where that is not known."""
    mirrored = load_alignment(path, source, mirrored=False).scale < 0
    note = f"{source}2radar has {'a' if mirrored else 'no'} reflection"
    try:
        if surface is None:
            raise HandbenchError("there is nothing to check it by")
        vertices, faces = surface()
        own_mm, other_mm = _off_mm(load_alignment(path, source).points(vertices), faces, echoes())
        if min(own_mm, other_mm) > FAR_MM:
            raise HandbenchError(f"the radar's depth lies {own_mm:.0f} mm from it, and {other_mm:.0f} mm mirrored")
        side = "further off" if other_mm >= own_mm else "nearer to"
        note += f"; mirrored, what it saw lies {abs(other_mm - own_mm):.1f} mm {side} the radar's depth"
        mirrored ^= other_mm < min(own_mm - CLEAR_MM, own_mm / 2)
    except HandbenchError as error:
        note += f", which was not checked ({error})"
    note += f": x of its radar frame is {'negated' if mirrored else 'taken as it is'}"
    say(f"{path}: {note}")
    return Handedness(mirrored, note)


def _off_mm(vertices_m: np.ndarray, faces: np.ndarray, echoes: RadarCapture) -> tuple[float, float]:
    """Mean distance of the radar's points from a surface, and from its mirror image in x."""
    from scipy.spatial import KDTree

    chosen, middle_m = method("3fsk"), float(np.median(vertices_m[:, 2]))
    look = LOOK | ({"first_depth_m": middle_m} if middle_m > 0 else {})
    depth = chosen.run(echoes, chosen.configure(look, "handedness"), 0).depth
    z_m = depth.z_m if depth.wrapped is None else np.where(depth.wrapped, np.nan, depth.z_m)
    surface_m = depth_on_grid(mesh(vertices_m, faces), depth.x_m, depth.y_m)
    if not (np.isfinite(surface_m).any() and np.isfinite(z_m).any()):
        raise HandbenchError("what it saw lies beside the radar's pixels, or these are empty")
    x_m, y_m = np.meshgrid(depth.x_m, depth.y_m)
    seen_m, *both_m = (
        np.stack([x_m, y_m, one_m], -1)[np.isfinite(one_m)] for one_m in (z_m, surface_m, surface_m[:, ::-1])
    )
    own_m, other_m = (float(KDTree(surface).query(seen_m)[0].mean()) for surface in both_m)
    return 1e3 * own_m, 1e3 * other_m


def load_any_transform(file: Path | None) -> Transform:
    """A transform into the radar frame: our form, or MAROON's in a file of that name, alignment.json; without a file,
    of what lies there already."""
    if file is None:
        return identity("radar")
    transform = load_alignment(file) if file.name == ALIGNMENT else load_transform(file)
    return transform.require(transform.source, "radar", file)
