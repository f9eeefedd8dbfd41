"""Problems of folders of photographs: their cameras, and the board that gives the scale."""

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path

import numpy as np

from handbench.bench.datasets.native import DESCRIPTION, ECHOES, FAR_M
from handbench.bench.validation.problems import Problem, attempt, parsed
from handbench.groundtruth.board.board import Board
from handbench.groundtruth.cameras.camera_files import cameras_of
from handbench.groundtruth.cameras.cameras import Camera, CameraFile
from handbench.groundtruth.photos.photos import SUFFIXES, Photo, find_photos

NEAREST_M, FARTHEST_M = 0.05, 2.0  # that photographs of a hand are taken from, from the board beside it
LOOKED_AT, FEWEST_SEEN = 3, 4  # photographs in which a board is looked for, at most; corners that make it one


def is_of_photographs(folder: Path) -> bool:
    """True if pictures lie in the folder itself, and no capture does."""
    pictures = any(file.suffix.lower() in SUFFIXES for file in folder.iterdir())
    return pictures and not any((folder / name).exists() for name in (DESCRIPTION, ECHOES))


def photo_problems(folder: Path, scaled: bool = True) -> Iterator[Problem]:
    """All problems of a folder of photographs, its cameras.json and its board.toml; scaled: one of these must give the
    scale."""
    photos = yield from attempt(folder, lambda: find_photos(folder))
    described, cameras = folder / "board.toml", folder / "cameras.json"
    board, known = None, None
    if described.exists():
        _, board = yield from parsed(Board, described, "an ArUco board description")
    posed = 0
    if cameras.exists():
        _, told = yield from parsed(CameraFile, cameras, 'a cameras file {"cameras": [...]}')
        posed = sum(camera.R is not None and camera.t is not None for camera in told.cameras) if told else 0
        if told is not None and photos is not None:
            known = yield from attempt(cameras, partial(cameras_of, photos, cameras))
    if not described.exists() and posed < 3:
        text = "nothing gives the scale; add board.toml, or poses (R, t) to cameras.json"
        yield Problem(folder, None, text, warning=not scaled)
    for text in board_doubts(photos or (), board, known or ()) if board else ():
        yield Problem(described, None, text, warning=True)


def board_doubts(photos: Sequence[Photo], board: Board, cameras: Sequence[Camera] = ()) -> Iterator[str]:
    """A doubt about the board's unit: its corners lie out of reach, or the first photograph that shows it, with a
    camera's focal length or the photograph's own, was taken from further or nearer than cameras stand about a hand."""
    from handbench.groundtruth.board.markers import detect_corners, focal_length_px

    corners_m = {(id, k): corner for id, quad in board.corners_m().items() for k, corner in enumerate(quad)}
    reach_m = float(np.abs(list(corners_m.values())).max())
    if reach_m > FAR_M:
        yield f"a corner lies {reach_m:g} m away; are these millimetres?"
        return
    for photo, camera in zip_longest(photos[:LOOKED_AT], cameras[:LOOKED_AT]):
        seen = detect_corners(photo, board)
        if len(seen) < FEWEST_SEEN:
            continue
        told_px = camera.params[0] if camera else photo.focal_px or focal_length_px(photo, seen, board)
        board_m, seen_px = (
            np.linalg.norm(np.std(of, axis=0)) for of in ([corners_m[at] for at in seen], [*seen.values()])
        )
        distance_m = (told_px or max(photo.width, photo.height)) * float(board_m / seen_px)
        if not NEAREST_M < distance_m < FARTHEST_M:
            scale = "large" if distance_m > FARTHEST_M else "small"
            seen_from = f"{photo.name} was taken {distance_m:.2g} m from the board"
            yield f"{seen_from}: is that ten times too {scale}? measure a marker, in metres"
        return
