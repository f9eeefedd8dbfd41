"""What goes into a reconstruction, gathered and checked: everything that can be refused before the work starts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration import HandbenchError, content_hash, track
from groundtruth.board import Board, load_board
from groundtruth.cameras import Camera, load_cameras
from groundtruth.markers import Corners, detect_corners, focal_length_px, require_board
from groundtruth.options import Options
from groundtruth.photos import Photo, find_photos


@dataclass(frozen=True)
class Inputs:
    """The photographs; the known camera of each (None: unknown); the board (None: none) and its corners in each."""

    photos: tuple[Photo, ...]
    cameras: tuple[Camera, ...] | None
    board: Board | None
    corners: dict[str, Corners]

    def content(self) -> list[Any]:
        """Everything in here, as `content_hash` takes it."""
        cameras = None if self.cameras is None else [camera.model_dump() for camera in self.cameras]
        board = None if self.board is None else self.board.model_dump()
        return [content_hash(*(part for photo in self.photos for part in (photo.name, photo.path))), cameras, board]

    def focal_lengths_px(self) -> dict[str, float]:
        """A focal length for each photograph, from the board or, where it shows too little of it, from the others."""
        if self.board is None:
            return {}
        found = {photo.name: focal_length_px(photo, self.corners[photo.name], self.board) for photo in self.photos}
        known = [focal for focal in found.values() if focal is not None]
        return {name: focal or float(np.median(known)) for name, focal in found.items()} if known else {}


def gather(folder: Path, options: Options) -> tuple[Inputs, Options]:
    """The inputs in a folder of photographs, and the options with the files found there filled in."""
    options.box()
    photos = find_photos(folder)
    options = _found_beside(folder, options)
    if options.cameras is not None and options.intrinsics is not None:
        raise HandbenchError("cameras and intrinsics: both are given; give the intrinsics in one of them")
    cameras = None if options.cameras is None else _cameras_of(photos, options.cameras)
    board = None if options.board is None else load_board(options.board)
    posed = cameras is not None and sum(c.R is not None and c.t is not None for c in cameras) >= 3
    if board is None and not posed and not options.unscaled:
        raise HandbenchError(
            f"{folder}: nothing gives the scale: no board.toml and no camera poses (R, t in cameras.json); "
            "add --board or --cameras, or give --unscaled for a mesh of arbitrary size"
        )
    return Inputs(photos, cameras, board, _find_board(photos, board)), options


def _found_beside(folder: Path, options: Options) -> Options:
    """The options with the cameras.json and board.toml that lie beside the photographs, unless others are given."""
    beside = {"cameras": folder / "cameras.json", "board": folder / "board.toml"}
    if options.intrinsics is not None:
        del beside["cameras"]
    found = {key: path for key, path in beside.items() if getattr(options, key) is None and path.is_file()}
    return options.model_copy(update=found)


def _cameras_of(photos: tuple[Photo, ...], path: Path) -> tuple[Camera, ...]:
    """The file's camera of each photograph."""
    known = {camera.name: camera for camera in load_cameras(path)}
    for photo in photos:
        camera = known.get(photo.name)
        if camera is None:
            raise HandbenchError(f"{path}: has no camera for {photo.name}; add one, or remove the photograph")
        if (camera.width, camera.height) != (photo.width, photo.height):
            raise HandbenchError(
                f"{path}: {photo.name} is {camera.width} × {camera.height} there, the photograph has {photo.width} × "
                f"{photo.height} pixels; calibrate at the size of the stored pixels (EXIF orientation is ignored)"
            )
        camera.colmap()
    return tuple(known[photo.name] for photo in photos)


def _find_board(photos: tuple[Photo, ...], board: Board | None) -> dict[str, Corners]:
    if board is None:
        return {}
    return require_board({p.name: detect_corners(p, board) for p in track(photos, "markers")}, board)
