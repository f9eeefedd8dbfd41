"""MAROON's JSON files, above all that of transforms, `alignment.json` (Wirth et al. 2024, arXiv
2411.00527).

Under each key `SOURCE2DEST`, the file has a 4×4 matrix, row by row, that maps columns [p, 1] from
one frame to another. Read is `photogrammetry2radar`, both in metres.

MAROON's code uses a left-handed radar frame (x to the right, y up, z away), so that p_handbench =
diag(−1, 1, 1) p_maroon, and the matrix from the right-handed photogrammetry contains a reflection.
Without one, the radar frame is taken to be handbench's already.
"""

from pathlib import Path

import numpy as np

from handbench.calibration.transforms import Matrix, Transform, identity, load_transform
from handbench.support.config import Config, ConfigT, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import RAW_JSON_BYTES, RAW_VALUES, read_json
from handbench.support.progress import say

ALIGNMENT, KEY = "alignment.json", "photogrammetry2radar"
# largest element by which a matrix may miss its rotation: without a message, and at all
ROUNDING, TOO_CROOKED = (1e-6, 1e-3)
MIRROR_X = np.diag([-1.0, 1.0, 1.0, 1.0])


class Alignment(Config, extra="ignore"):
    """The used part of an `alignment.json`."""

    photogrammetry2radar: Matrix


def load_part(model: type[ConfigT], path: Path) -> ConfigT:
    """Read the used part of one of MAROON's JSON files, which also hold intermediate data. Raises
    HandbenchError for a file that is missing or too large, or has wrong values."""
    content = read_json(path, f"MAROON's {path.name}", RAW_VALUES, RAW_JSON_BYTES)
    return parse(model, content, str(path))


def load_alignment(path: Path) -> Transform:
    """Read the transform from the frame of the photographs to handbench's radar frame from an
    alignment.json. It has no covariance.

    The matrix is replaced by the nearest rotation (polar decomposition) times the mean stretch, and
    a small change is printed. Raises HandbenchError unless the matrix is a finite 4×4 similarity.
    """
    matrix = load_matrix(path)
    if is_mirrored(matrix):
        matrix = MIRROR_X @ matrix
    u, stretch, vt = np.linalg.svd(matrix[:3, :3])
    scale, straight = float(stretch.mean()), np.eye(4)
    straight[:3, :3], straight[:3, 3] = scale * (u @ vt), matrix[:3, 3]
    crooked = float(np.abs(matrix - straight).max())
    if crooked >= TOO_CROOKED * scale:
        raise HandbenchError(
            f"{path}: '{KEY}' differs by {crooked:.2g} from a rotation with one scale; expected "
            f"less than {TOO_CROOKED:g} in any element; download the file again, or correct it"
        )
    if crooked > ROUNDING:
        say(
            f"{path}: '{KEY}' differs by {crooked:.1e} from a rotation, so the nearest rotation "
            "is used"
        )
    return Transform("photo", "radar", straight)


def is_mirrored(matrix: np.ndarray) -> bool:
    """Tell whether x of the radar frame of an alignment.json's matrix is opposite to handbench's:
    whether the matrix contains a reflection."""
    return bool(np.linalg.det(matrix[:3, :3]) < 0)


def load_matrix(path: Path) -> np.ndarray:
    """Read the matrix [4, 4] of an alignment.json. Raises HandbenchError for other numbers."""
    return np.reshape(load_part(Alignment, path).photogrammetry2radar, (4, 4))


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
