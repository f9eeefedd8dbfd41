"""`alignment.json`, the file of transforms of the MAROON data set (Wirth et al. 2024, arXiv 2411.00527).

It holds 4×4 matrices in row order under `SOURCE2DEST`, applied to columns [p, 1], between the frames of the sensors
`radar`, `photogrammetry`, `kinect`, `realsense`, `zed` and a common `world`. What the public code says of them:

- Radar frame: origin at the aperture's centre, x right, y up, z away (the drawing in `RadarControllerBase.
  initialize_reconstruction`), which is left-handed. The antennas' file is the opposite in x ("the reconstruction
  coordinate system"), and its x is negated before imaging. That file is ours, so that p_ours = diag(−1, 1, 1)·p_theirs.
  A third party that simulates the data set does the same the other way round: it carries the mesh by
  `photogrammetry2radar`, negates x, and computes echoes with the antennas as they are in the file, looking along +z.
- Handedness: a camera or a photogrammetric mesh is right-handed, so that `X2radar` contains one reflection (negative
  determinant). The code does not show it (no matrix is published with it), hence the argument `mirrored`; a file that
  contradicts it is refused, since no rotation could then carry the one to the other.
- Units: radar in metres (bounds of 0.2 to 0.9 and `mask_bb` are compared with points in it); photogrammetry in metres
  (`transform_error_to_meters` divides errors in the frames of the three cameras by 1000, there not at all); so
  `kinect2radar`, `realsense2radar` and `zed2radar` have a scale of 1/1000 and lead from millimetres.
- Their `spatial_alignment.transform` takes `SOURCE2DEST` if it is there, else `SOURCE2radar` and inverses.
"""

from pathlib import Path
from typing import Any

import numpy as np

from calibration.transforms import Transform, checked_numbers, load_transform
from radar.support.config import suggest
from radar.support.errors import HandbenchError
from radar.support.files import read_json, write_json
from radar.support.limits import RAW_JSON_BYTES, RAW_VALUES
from radar.support.progress import say

ALIGNMENT = "alignment.json"
ROUNDING, TOO_CROOKED = 1e-6, 1e-3  # largest element by which a matrix may miss its rotation: unsaid, and at all
FARTHEST_M = 10.0  # no two sensors of the set-up stand further apart; more are millimetres
MIRROR_X = np.diag([-1.0, 1.0, 1.0, 1.0])
FRAMES = {"photogrammetry": "photo"}  # ours for theirs; the others keep their names


def load_alignment(path: str | Path, source: str = "photogrammetry", mirrored: bool = True) -> Transform:
    """`radar_from_SOURCE` in our radar frame, metres; it carries no covariance. `photogrammetry` becomes our `photo`.

    source: a sensor of the file; its points are in the unit that the file's matrix expects (see above), which the
    transform's scale shows. mirrored: whether the file's radar frame has x to the right. The matrix is brought to the
    nearest rotation with a scale. Raises HandbenchError for anything but a finite 4×4 similarity, for an unknown
    source, and where the handedness contradicts `mirrored`.
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
    matrix = MIRROR_X @ matrix if mirrored else matrix
    return Transform(FRAMES.get(source, source), "radar", _straight(path, key, matrix, mirrored))


def save_alignment(path: str | Path, transform: Transform, mirrored: bool = True) -> None:
    """Write `radar_from_photo` in MAROON's form, atomically: `photogrammetry2radar` and its inverse.

    An existing file keeps its other keys; those that lead to or from the photogrammetry without the radar stay as they
    were, and speak of another calibration then. A new file gets what their viewer asks for besides: `radar2world`,
    whose axes are the radar's, and the word that no Kinect matrix waits for correction. The covariance has no place
    there.
    """
    transform.require("photo", "radar", "transform")
    known: dict[str, Any] = {"radar2world": np.eye(4), "kinect_calib": {"space": "depth"}}
    if Path(path).exists():
        known |= read_table(path)
    flip = MIRROR_X if mirrored else np.eye(4)  # from their radar frame to ours, or back
    there, back = flip @ transform.matrix, transform.inverse().matrix @ flip
    write_json(path, known | {"photogrammetry2radar": there, "radar2photogrammetry": back})


def read_table(path: str | Path, what: str = "MAROON's alignment.json") -> dict[str, Any]:
    """One of MAROON's JSON files, which hold a table; anything else, or a larger one, is a HandbenchError."""
    content = read_json(path, what, RAW_VALUES, RAW_JSON_BYTES)  # it also holds intermediate data of the calibration
    if not isinstance(content, dict):
        raise HandbenchError(f"{path}: holds no table of transforms or facts; expected {what}")
    return content


def _straight(path: str | Path, key: str, matrix: np.ndarray, mirrored: bool) -> np.ndarray:
    """The matrix with the nearest rotation (polar decomposition) and the mean stretch as scale; says how far it was."""
    u, stretch, vt = np.linalg.svd(matrix[:3, :3])
    scale, rotation = float(stretch.mean()), u @ vt
    crooked = float(np.abs(matrix[:3, :3] / scale - rotation).max()) if scale > 0 else np.inf
    if crooked > TOO_CROOKED:
        raise HandbenchError(
            f"{path}: '{key}' is {crooked:.2g} off a rotation with one scale; expected {TOO_CROOKED:g} at most"
        )
    if np.linalg.det(rotation) < 0:
        has, other = ("no reflection", False) if mirrored else ("a reflection", True)
        raise HandbenchError(
            f"{path}: '{key}' has {has}, which a right-handed source and mirrored={mirrored} rule out; if the file's "
            f"radar frame is the other one, ask for mirrored={other}; else its source is a mirror image, to be undone"
        )
    if crooked > ROUNDING:
        say(f"{path}: '{key}' was {crooked:.1e} off a rotation; the nearest one is taken")
    straight = matrix.copy()
    straight[:3, :3] = scale * rotation
    straight[3] = [0, 0, 0, 1]
    return straight


def load_any_transform(file: Path) -> Transform:
    """A transform into the radar frame: our form, or MAROON's in a file of that name, alignment.json."""
    transform = load_alignment(file) if file.name == ALIGNMENT else load_transform(file)
    return transform.require(transform.source, "radar", file)
