"""Collection and checks of everything that a reconstruction needs, before its work starts."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from handbench.groundtruth.board.board import Board, load_board
from handbench.groundtruth.board.markers import (
    Corners,
    detect_corners,
    focal_length_px,
    require_board,
)
from handbench.groundtruth.cameras.camera_files import cameras_of
from handbench.groundtruth.cameras.cameras import Camera, cuda_devices
from handbench.groundtruth.options import Options, SparseOptions
from handbench.groundtruth.photos.masks import read_mask
from handbench.groundtruth.photos.photos import Photo, find_photos, select_usable
from handbench.groundtruth.sparse.frame import require_near
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash
from handbench.support.progress import track

Chosen = TypeVar("Chosen", bound=SparseOptions)


@dataclass(frozen=True)
class SparseInputs:
    """Inputs of the sparse stage, which registers the photographs.

    cameras: known camera of each photograph (None: unknown). board: the board's description (None:
    no board). corners: pixels of the board's corners, by the photograph's name. model: folder of a
    COLMAP model of the photographs (None: structure from motion makes one).
    """

    photos: tuple[Photo, ...]
    cameras: tuple[Camera, ...] | None
    board: Board | None
    corners: dict[str, Corners]
    model: Path | None = None

    @property
    def posed(self) -> bool:
        """True if the pose of every photograph is known and no COLMAP model is given."""
        return (
            self.model is None
            and self.cameras is not None
            and all(camera.posed for camera in self.cameras)
        )

    def focal_lengths_px(self) -> dict[str, float]:
        """Estimate the focal length of each photograph in pixels from its view of the board.

        A photograph that shows too little of the board gets the median of the others. Returns the
        focal lengths by the photograph's name; empty if there is no board, or if no photograph
        gives an estimate.
        """
        if self.board is None:
            return {}
        found = {
            photo.name: focal_length_px(photo, self.corners[photo.name], self.board)
            for photo in self.photos
        }
        known = [focal for focal in found.values() if focal is not None]
        return (
            {name: focal or float(np.median(known)) for name, focal in found.items()}
            if known
            else {}
        )


def resolve(folder: Path, options: Options) -> tuple[tuple[Photo, ...], Options]:
    """Find all photographs in a folder, and complete the options.

    Missing options are set to the cameras.json and board.toml in the folder, and to the device for
    depth maps, cpu or cuda. Returns the photographs and the completed options. Raises
    HandbenchError for options or masks that cannot be used.
    """
    options.box()
    devices = 0 if options.dense == "cpu" else cuda_devices()
    if options.dense == "cuda" and not devices:
        raise HandbenchError(
            "dense: CUDA is requested, but pycolmap finds no CUDA device; use a machine with an "
            "NVIDIA card and its driver, run pip install 'handbench[cuda]' (see `handbench "
            "doctor`), or leave the option out"
        )
    options = options.model_copy(update={"dense": "cuda" if devices else "cpu"})
    photos, options = _completed(folder, options)
    for photo in photos:
        read_mask(photo, options.masks)
    return photos, options


def _completed(folder: Path, options: Chosen) -> tuple[tuple[Photo, ...], Chosen]:
    """Find all photographs in a folder, and complete the options by the cameras.json and board.toml
    in the folder, if they are missing.

    Returns the photographs and the completed options. Raises HandbenchError for options that
    contradict each other.
    """
    photos = find_photos(folder)
    beside = {"cameras": folder / "cameras.json", "board": folder / "board.toml"}
    if options.intrinsics is not None:
        del beside["cameras"]
    found = {
        key: path
        for key, path in beside.items()
        if getattr(options, key) is None and path.is_file()
    }
    options = options.model_copy(update=found)
    _require_consistent(photos, options)
    return photos, options


def content(photos: tuple[Photo, ...], options: SparseOptions) -> list[Any]:
    """Return the hashes of everything that the cameras' poses depend on: of the photographs, and of
    the files or folders of cameras, board and COLMAP model (None: not given). options: completed by
    `resolve`."""
    given = (options.cameras, options.board, options.model)
    hashes = [None if path is None or not path.exists() else content_hash(path) for path in given]
    return [content_hash(*(part for photo in photos for part in (photo.name, photo.path))), *hashes]


def gather(folder: Path, options: Chosen) -> tuple[SparseInputs, Chosen]:
    """Collect and check the inputs of the sparse stage from a folder of photographs: the usable
    photographs, known cameras, and the board's corners.

    Returns the inputs and the completed options. Raises HandbenchError if nothing gives the scale,
    or if inputs contradict each other.
    """
    photos, options = _completed(folder, options)
    photos = select_usable(photos)
    cameras = (
        None if options.cameras is None else cameras_of(photos, options.cameras, options.metric)
    )
    board = None if options.board is None else load_board(options.board)
    posed = sum(camera.posed for camera in cameras or ())
    metric = options.model is not None and options.metric
    if not (options.board or posed >= 3 or metric or options.unscaled):
        raise HandbenchError(
            f"{folder}: nothing gives the scale, neither a board.toml nor camera poses (R, t in "
            "cameras.json); add --board or --cameras "
            "(--metric, if a COLMAP model is in metres), or give "
            "--unscaled for a mesh of arbitrary size"
        )
    require_near(cameras or ())
    corners: dict[str, Corners] = {}
    if board is not None:
        corners = require_board(
            {p.name: detect_corners(p, board) for p in track(photos, "markers")}, board
        )
    return SparseInputs(photos, cameras, board, corners, options.model), options


def _require_one(options: SparseOptions, first: str, second: str, advice: str) -> None:
    """Raise HandbenchError if two options that exclude each other are both given. first, second:
    names of the options; advice: end of the message."""
    if all(getattr(options, name) is not None for name in (first, second)):
        raise HandbenchError(
            f"{first}, {second}: both are given, but only one is allowed; {advice}"
        )


def _require_consistent(photos: tuple[Photo, ...], options: SparseOptions) -> None:
    """Check the options against each other and the photographs.

    Raises HandbenchError if options contradict each other, if an option needs another one that is
    missing, or if one camera's intrinsics are given for photographs of different sizes.
    """
    _require_one(options, "cameras", "intrinsics", "give the intrinsics only in one of them")
    _require_one(options, "model", "intrinsics", "leave out intrinsics, because the model has them")
    posed_by_colmap = options.model is not None or (
        options.cameras is not None and options.cameras.is_dir()
    )
    if options.metric and not posed_by_colmap:
        raise HandbenchError(
            "--metric: is only for a COLMAP model, which is not given; give one with "
            "--model or --cameras, or leave this option out"
        )
    sizes = sorted({(photo.width, photo.height) for photo in photos})
    if options.intrinsics is not None and len(sizes) > 1:
        listed = ", ".join(f"{width} × {height}" for width, height in sizes)
        raise HandbenchError(
            f"intrinsics: the photographs have different sizes ({listed}), so they cannot have "
            "the same intrinsics; give --cameras with a camera for each"
        )
