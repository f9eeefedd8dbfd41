"""MAROON's file of transforms, `alignment.json` (Wirth et al. 2024, arXiv 2411.00527).

Under each key `SOURCE2DEST`, the file has a 4×4 matrix, row by row, that maps columns [p, 1] from
one frame to another. Read is `photogrammetry2radar`, both in metres.

MAROON's code uses a left-handed radar frame (x to the right, y up, z away), so that p_handbench =
diag(−1, 1, 1) p_maroon, and the matrix from the right-handed photogrammetry contains a reflection.
Without one, the radar frame is taken to be handbench's already.
"""

from pathlib import Path
from typing import Any

import numpy as np

from handbench.calibration.transforms import Transform, checked_numbers, identity, load_transform
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json
from handbench.support.limits import RAW_JSON_BYTES, RAW_VALUES
from handbench.support.progress import say

ALIGNMENT, KEY = "alignment.json", "photogrammetry2radar"
# largest element by which a matrix may miss its rotation: without a message, and at all
ROUNDING, TOO_CROOKED = (1e-6, 1e-3)
FARTHEST_M = 10.0  # largest distance of two sensors of the set-up; more are millimetres
MIRROR_X = np.diag([-1.0, 1.0, 1.0, 1.0])


def load_alignment(path: str | Path) -> Transform:
    """Read the transform from the frame of the photographs to handbench's radar frame from an
    alignment.json. It has no covariance.

    The matrix is replaced by the nearest rotation times a scale. Raises HandbenchError unless the
    matrix is a finite 4×4 similarity.
    """
    matrix = _matrix(path)
    flip = MIRROR_X if np.linalg.det(matrix[:3, :3]) < 0 else np.eye(4)
    return Transform("photo", "radar", _straight(path, flip @ matrix))


def is_mirrored(path: str | Path) -> bool:
    """Tell whether x of an alignment.json's radar frame is opposite to handbench's: whether its
    matrix contains a reflection."""
    return bool(np.linalg.det(_matrix(path)[:3, :3]) < 0)


def _matrix(path: str | Path) -> np.ndarray:
    content = read_table(path)
    if KEY not in content:
        raise HandbenchError(f"{path}: has no '{KEY}'; copy the file again")
    matrix = checked_numbers(path, KEY, content[KEY], [(4, 4), (16,)]).reshape(4, 4)
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > ROUNDING:
        raise HandbenchError(
            f"{path}: the last row of '{KEY}' is {matrix[3].tolist()}; expected [0, 0, 0, 1]"
        )
    if np.linalg.norm(matrix[:3, 3]) > FARTHEST_M:
        raise HandbenchError(
            f"{path}: '{KEY}' has a shift of {np.linalg.norm(matrix[:3, 3]):.4g} m; expected at "
            f"most {FARTHEST_M:g} m; check that the unit is metres"
        )
    return matrix


def read_table(path: str | Path, what: str = "MAROON's alignment.json") -> dict[str, Any]:
    """Read one of MAROON's JSON files as a dict. what: description of the file for messages. Raises
    HandbenchError for a file that is too large, or whose content is not a table of keys and
    values."""
    # it also holds intermediate data of the calibration
    content = read_json(path, what, RAW_VALUES, RAW_JSON_BYTES)
    if not isinstance(content, dict):
        raise HandbenchError(f"{path}: is not a table; expected {what}; copy it again")
    return content


def _straight(path: str | Path, matrix: np.ndarray) -> np.ndarray:
    """Return a matrix [4, 4] with its linear part replaced by the nearest rotation (polar
    decomposition) times the mean stretch.

    A small change is printed; path: the matrix's file, for messages. Raises HandbenchError if the
    change would be large.
    """
    u, stretch, vt = np.linalg.svd(matrix[:3, :3])
    scale, rotation = float(stretch.mean()), u @ vt
    crooked = float(np.abs(matrix[:3, :3] / scale - rotation).max()) if scale > 0 else np.inf
    if crooked > TOO_CROOKED:
        raise HandbenchError(
            f"{path}: '{KEY}' differs by {crooked:.2g} from a rotation with one scale; expected "
            f"at most {TOO_CROOKED:g} in any element; download the file again, or correct it"
        )
    if crooked > ROUNDING:
        say(
            f"{path}: '{KEY}' differs by {crooked:.1e} from a rotation, so the nearest rotation "
            "is used"
        )
    straight = np.eye(4)
    straight[:3, :3], straight[:3, 3] = scale * rotation, matrix[:3, 3]
    return straight


def load_any_transform(file: Path | None) -> Transform:
    """Read a transform to the radar frame from a file in handbench's format or, if the file is
    named alignment.json, in MAROON's.

    file: None returns the identity, for points that are in the radar frame already. Raises
    HandbenchError for a file in neither format.
    """
    if file is None:
        return identity("radar")
    transform = load_alignment(file) if file.name == ALIGNMENT else load_transform(file)
    return transform.require(transform.source, "radar", file)
