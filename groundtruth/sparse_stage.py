"""The first stage of a reconstruction: from photographs to cameras and points in the metric
frame."""

from pathlib import Path
from typing import Any

from handbench.groundtruth.options import SparseOptions
from handbench.groundtruth.sparse.inputs import gather
from handbench.groundtruth.sparse.sparse import register
from handbench.support.config import parse
from handbench.support.store import stage


@stage("sparse", "groundtruth", "calibration/transforms.py")
def make(folder: Path, photos: str, options: dict[str, Any]) -> None:
    """Run the sparse stage: find the cameras of the photographs in the folder `photos`.

    COLMAP model, scale and covariance are written into `folder`. options: fields of SparseOptions.
    Raises HandbenchError, before the work starts, for inputs that cannot be reconstructed.
    """
    chosen = parse(SparseOptions, options, "groundtruth")
    register(gather(Path(photos), chosen), chosen).save(folder)
