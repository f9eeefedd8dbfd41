"""What is known of photographs before they are registered: their cameras, and a board's corners."""

from dataclasses import dataclass, field
from pathlib import Path

from handbench.groundtruth.board import Board, load_board
from handbench.groundtruth.camera_files import cameras_of
from handbench.groundtruth.cameras import Camera
from handbench.groundtruth.markers import Corners, detect_corners, require_board
from handbench.groundtruth.options import SparseOptions
from handbench.groundtruth.photos import FEWEST, Photo, find_photos, select_usable
from handbench.groundtruth.sparse.frame import require_near
from handbench.support.errors import HandbenchError
from handbench.support.progress import track


@dataclass(frozen=True)
class Known:
    """What is known of photographs before they are registered.

    cameras: lens and, if known, pose of each photograph, in their order; empty if the lenses are
    unknown. metric: True if the poses are in metres. board: description of the board (None: no
    board). corners: pixels of the board's corners, by the photograph's name.
    """

    photos: tuple[Photo, ...]
    cameras: tuple[Camera, ...] = ()
    metric: bool = True
    board: Board | None = None
    corners: dict[str, Corners] = field(default_factory=dict)

    @property
    def posed(self) -> bool:
        """True if the pose of every photograph is known."""
        return bool(self.cameras) and all(camera.posed for camera in self.cameras)


def files_given(folder: Path, options: SparseOptions) -> tuple[Path | None, Path | None]:
    """Return the cameras' file or folder and the board's description: those in the options or, if
    they are missing, cameras.json and board.toml in the photographs' folder (None: not given).
    Raises HandbenchError if cameras and intrinsics are given."""
    if options.cameras is not None and options.intrinsics is not None:
        raise HandbenchError(
            "cameras, intrinsics: both are given; give the lenses in only one of them"
        )
    cameras, board = folder / "cameras.json", folder / "board.toml"
    beside = cameras.is_file() and options.intrinsics is None
    return (
        options.cameras or (cameras if beside else None),
        options.board or (board if board.is_file() else None),
    )


def gather(folder: Path, options: SparseOptions) -> Known:
    """Collect what is known of the photographs in a folder.

    Photographs that are of no use, or that a COLMAP model lacks, are left out and reported. Raises
    HandbenchError if nothing gives the scale, or if inputs contradict each other.
    """
    given, described = files_given(folder, options)
    photos = select_usable(find_photos(folder))
    cameras: tuple[Camera, ...] = ()
    if options.intrinsics is not None:
        cameras = _pinholes(photos, options.intrinsics)
    elif given is not None:
        cameras = cameras_of(photos, given)
        names = [camera.name for camera in cameras]
        photos = tuple(photo for photo in photos if photo.name in names)
    require_near(cameras)
    metric = options.metric or given is None or not given.is_dir()
    posed = sum(camera.posed for camera in cameras)
    if not (described or (metric and posed >= FEWEST) or options.unscaled):
        raise HandbenchError(
            f"{folder}: nothing gives the scale, neither a board.toml nor camera poses (R, t in "
            "cameras.json); add --board or --cameras (--metric, if a COLMAP model is in metres), "
            "or give --unscaled for a mesh of arbitrary size"
        )
    if described is None:
        return Known(photos, cameras, metric and not options.unscaled)
    board = load_board(described)
    corners = {photo.name: detect_corners(photo, board) for photo in track(photos, "markers")}
    return Known(photos, cameras, metric, board, require_board(corners, board))


def _pinholes(photos: tuple[Photo, ...], params: tuple[float, ...]) -> tuple[Camera, ...]:
    """Return cameras without distortion, of the same intrinsics. params: fx, fy, cx, cy in pixels.
    Raises HandbenchError for photographs of different sizes."""
    sizes = sorted({(photo.width, photo.height) for photo in photos})
    if len(sizes) > 1:
        raise HandbenchError(
            f"intrinsics: the photographs have different sizes ("
            f"{', '.join(f'{width} × {height}' for width, height in sizes)}), so they cannot have "
            "the same intrinsics; give --cameras with a camera for each"
        )
    return tuple(
        Camera(name=p.name, width=p.width, height=p.height, model="PINHOLE", params=params)
        for p in photos
    )
