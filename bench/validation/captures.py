"""Inspection of captures and photographs: everything that a run may read is read, and all problems
are reported."""

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import (
    DESCRIPTION,
    MESH,
    PHOTOS,
    TARGET,
    TRANSFORM,
    NativeCapture,
)
from handbench.bench.stages.image import configured, require_near
from handbench.bench.validation.checks import (
    CHANNELS,
    Report,
    lengths,
    missing_frames,
    size,
    transform_warnings,
    warnings_of,
)
from handbench.calibration.target import load_target
from handbench.groundtruth.board import Board, load_board
from handbench.groundtruth.camera_files import cameras_of
from handbench.groundtruth.cameras import Camera
from handbench.groundtruth.mesh.surface import read_surface
from handbench.groundtruth.photos import Photo, find_photos
from handbench.radar.data.capture import RadarCapture
from handbench.support.errors import HandbenchError

FEWEST_POSES = 3  # of photographs, which give their scale
# of cameras that photograph a hand, from the board next to it
NEAREST_M = 0.05
FARTHEST_M = 2.0
LOOKED_AT = 3  # photographs in which a board is looked for, at most
FEWEST_SEEN = 4  # corners that make it a board


def inspect_capture(
    folder: Path, report: Report, frames: int | None = None
) -> tuple[NativeCapture, RadarCapture] | None:
    """Read all files of a capture that a run may read, and report their problems and warnings.
    Returns the capture and the echoes of its first `frames` frames (None: all); None if its
    description or its echoes cannot be read."""
    read = partial(report.read, folder)
    recorded = read(open_capture, folder)
    if recorded is None:
        return None
    about = read(lambda: recorded.about)
    if about is not None:
        report.warn(folder / DESCRIPTION, lengths(about))
        for id in about.methods:
            report.read(folder / DESCRIPTION, configured, about, id, {})
        if about.kind == "target" and not (recorded.folder / TARGET).exists():
            report.refuse(folder, f"is a capture of the calibration target without {TARGET}")
    echoes = read(recorded.echoes, frames)
    if echoes is not None:
        read(require_near, echoes)
        if not echoes.samples[0].any():
            report.refuse(folder, "frame 0, which a run images, has no echo; record it again")
        report.warn(folder, [*missing_frames(echoes, frames), *warnings_of(echoes, CHANNELS)])
    mesh = read(recorded.mesh)
    truths = None if echoes is None else read(recorded.truths, len(echoes.samples))
    surfaces = {}
    for file in filter(None, (recorded.truth, mesh, *(truths or ()))):
        surfaces[file] = read(read_surface, file)
        report.check(file, surfaces[file], (size,))
    transform = read(recorded.transform)
    if transform is not None:
        surface = surfaces.get(mesh) if mesh else None
        report.warn(recorded.folder / TRANSFORM, transform_warnings(transform, surface))
    if (file := recorded.folder / TARGET).exists():
        read(load_target, file)
    if recorded.photos is not None:
        inspect_photos(recorded.photos, report)
    return None if about is None or echoes is None else (recorded, echoes)


def require_reference(recorded: NativeCapture, calibrated: bool) -> None:
    """Raise HandbenchError if a capture has no surface to compare depths with. calibrated: whether
    a benchmark's calibration gives the transform."""
    if recorded.truth is not None:
        return
    if recorded.mesh() is None and recorded.photos is None:
        raise HandbenchError(
            f"{recorded.folder}: has no surface to compare depths with; add {PHOTOS} or {MESH}"
        )
    if not calibrated and recorded.transform() is None:
        raise HandbenchError(
            f"{recorded.folder}: nothing transforms its surface to the radar frame; add "
            f"{TRANSFORM} to the capture, or [calibration] to the benchmark"
        )


def inspect_photos(folder: Path, report: Report, scaled: bool = True) -> None:
    """Read a folder of photographs with its board.toml and cameras.json, and report their problems
    and warnings. scaled: whether one of these two files must give the scale; if not, its absence is
    only a warning."""
    described, posed = folder / "board.toml", folder / "cameras.json"
    photos = report.read(folder, find_photos, folder) or ()
    board = report.read(described, load_board, described) if described.exists() else None
    cameras = report.read(posed, cameras_of, photos, posed) if posed.exists() else None
    poses = [camera for camera in cameras or () if camera.posed]
    if not described.exists() and len(poses) < FEWEST_POSES:
        text = (
            "nothing gives the scale of the photographs; add board.toml, or poses (R, t) to "
            "cameras.json"
        )
        report.refuse(folder, text) if scaled else report.warn(folder, [text])
    if board is not None:
        report.warn(described, board_warnings(photos, board, cameras or ()))


def board_warnings(
    photos: Sequence[Photo], board: Board, cameras: Sequence[Camera] = ()
) -> Iterator[str]:
    """Check that a board is in metres: the first photograph that shows it was taken from a
    plausible distance. cameras: give the focal length; without them, the
    view of the board does."""
    from handbench.groundtruth.markers import detect_corners, focal_length_px  # with cv2

    corners_m = board.corners_m()
    for photo, camera in zip_longest(photos[:LOOKED_AT], cameras[:LOOKED_AT]):
        seen = detect_corners(photo, board)
        if len(seen) < FEWEST_SEEN:
            continue
        size = photo.width, photo.height
        focal_px = camera.params[0] if camera else focal_length_px([seen], size, board)
        board_m = np.linalg.norm(np.std([corners_m[id][k] for id, k in seen], axis=0))
        board_px = np.linalg.norm(np.std([*seen.values()], axis=0))
        distance_m = (focal_px or max(size)) * float(board_m / board_px)
        if not NEAREST_M < distance_m < FARTHEST_M:
            yield (
                f"{photo.name} was taken {distance_m:.2g} m from the board, as the board's "
                "description has it; measure a marker and give its side in metres"
            )
        return
