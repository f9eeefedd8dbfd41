"""Checks of capture folders, in handbench's own or any other supported form, and of folders of
photographs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import (
    ARRAY,
    DESCRIPTION,
    ECHOES,
    EMPTY,
    FAR_M,
    MESH,
    PHOTOS,
    TARGET,
    TRANSFORM,
    TRUTHS,
    CaptureFile,
    NativeCapture,
)
from handbench.bench.pipeline.image import configured
from handbench.bench.validation.checks import (
    echo_warnings,
    surface_warnings,
    transform_warnings,
    warnings_of,
)
from handbench.bench.validation.problems import (
    Found,
    ParsedFile,
    Problem,
    attempt,
    findings,
    parse_model,
    warnings_at,
)
from handbench.calibration.array.array_file import with_calibration
from handbench.calibration.spheres.description import Target
from handbench.groundtruth.board.board import Board
from handbench.groundtruth.cameras.camera_files import cameras_of
from handbench.groundtruth.cameras.cameras import Camera, CameraFile
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.groundtruth.photos.photos import UNREAD, Photo, find_photos
from handbench.radar.data.arrays import PlanarScan
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import load_capture
from handbench.radar.methods.advice import require_tones
from handbench.radar.methods.registry import method
from handbench.support.config import Config, Location
from handbench.support.errors import HandbenchError
from handbench.support.files import inside
from handbench.support.pictures import SUFFIXES

# photographs in which a board is looked for, at most; corners that make it one
LOOKED_AT, FEWEST_SEEN = (3, 4)


@dataclass(frozen=True)
class CheckedCapture:
    """What the checks of a benchmark need to know of a capture.

    about: its description (None: unreadable). frequencies_hz [f]: its tones. frames: number of its
    frames (None: any). scored: whether it can be scored (without, with) a transform from a
    calibration. lacks: files that a calibration needs and that it does not have. times_s [f]: when
    its tones are measured (None: unknown). refused: whether a file with a surface cannot be read.
    """

    about: CaptureFile | None = None
    frequencies_hz: np.ndarray | None = None
    frames: int | None = None
    scored: tuple[bool, bool] = (True, True)
    lacks: tuple[str, ...] = ()
    times_s: np.ndarray | None = None
    refused: bool = False

    @property
    def use(self) -> str:
        """What the capture can be used for, and what is missing to compare its depths; "" for a
        capture of the calibration target and for one that cannot be read."""
        if self.about is None or self.frequencies_hz is None or self.refused:
            return ""
        if self.about.kind == "target":
            return ""
        if self.scored[0]:
            return "can be imaged, and its depths can be compared with its surface"
        missing = (
            f"{TRANSFORM}, or [calibration] to a benchmark"
            if self.scored[1]
            else f"{PHOTOS} or {MESH}"
        )
        return f"can be imaged; to compare its depths with a surface, add {missing}"

    def refusal(self, id: str, asked: dict[str, Any]) -> str | None:
        """Return the reason why a method cannot image the capture with its tones; None if it can.
        id: the method; asked: settings in the benchmark, which override those of the capture."""
        if self.about is None or self.frequencies_hz is None:
            return None
        try:
            config = configured(self.about, id, asked)
        except HandbenchError:
            return None  # a separate problem
        samples = np.zeros((1, len(self.frequencies_hz), 1), np.complex64)
        try:
            place = PlanarScan(np.zeros((1, 3)))
            capture = RadarCapture(samples, self.frequencies_hz, place, times_s=self.times_s)
            require_tones(capture, config)
        except HandbenchError as error:
            return str(error)
        return None


def is_native(folder: Path) -> bool:
    """Return True for a capture folder in handbench's own form."""
    return (folder / ECHOES).exists() or (folder / DESCRIPTION).exists()


def is_of_photographs(folder: Path) -> bool:
    """Return True if the folder is not a capture and has photographs directly in it, readable or
    not."""
    pictures = {*SUFFIXES, *UNREAD}
    return not is_native(folder) and any(
        file.suffix.lower() in pictures for file in folder.iterdir()
    )


def capture_problems(folder: Path, scored: bool) -> Found[CheckedCapture]:
    """Yield all problems of a capture of any supported form. Returns what the checks of a benchmark
    need to know of it.

    A missing file is a problem only if something needs it. scored: whether a reference surface is
    needed; if not, echoes are enough.
    """
    native = is_native(folder)
    capture = (
        NativeCapture(folder)
        if native
        else (yield from attempt(folder, lambda: open_capture(folder)))
    )
    if capture is None:
        return CheckedCapture()
    about = yield from (_described(folder) if native else attempt(folder, lambda: capture.about))
    echoes = yield from _echoes(folder / ECHOES if native else folder, capture)
    mesh = yield from attempt(folder, capture.mesh)
    truths = yield from attempt(folder / TRUTHS, partial(_truths, capture, echoes))
    surfaces: dict[Path | None, Surface | None] = {}
    for file in filter(None, (capture.truth, mesh, *(truths or ()))):
        surfaces[file] = yield from surface_problems(file)
    file = folder / TRANSFORM if (folder / TRANSFORM).exists() else folder
    transform = yield from attempt(file, capture.transform)
    yield from warnings_at(
        file, transform_warnings(transform, surfaces.get(mesh)) if transform else ()
    )
    if (folder / TARGET).exists():
        yield from _target(folder / TARGET)
    if (folder / PHOTOS).is_dir():
        yield from photo_problems(folder / PHOTOS)
    there = {TARGET: (folder / TARGET).exists(), PHOTOS: capture.photos is not None}
    there[ECHOES] = not native or (folder / ECHOES).exists()
    lacks = tuple(name for name in there if not there[name])
    kind = about.kind if about is not None else "other"
    yield from findings(folder, "capture", kind=kind, lacks=lacks)
    true, measured = capture.truth is not None, mesh is not None or capture.photos is not None
    if scored and kind != "target":
        yield from findings(folder, "reference", known=true or measured)
    frequencies_hz, frames = (
        (echoes.frequencies_hz, len(echoes.samples)) if echoes else (None, None)
    )
    carried = transform is not None or file != folder
    return CheckedCapture(
        about,
        frequencies_hz,
        frames,
        (true or (measured and carried), true or measured),
        lacks,
        None if echoes is None else echoes.times_s,
        None in surfaces.values(),
    )


def _described(folder: Path) -> Found[CaptureFile | None]:
    """Yield the problems of a capture.toml, and of the files, lengths and methods in it. Returns
    its content (None: malformed)."""
    parsed, about = yield from parse_model(
        CaptureFile, folder / DESCRIPTION, "a capture description"
    )
    if not isinstance(parsed.values, dict):
        return None
    contains = parsed.values.get("contains")
    for index, name in enumerate(contains if isinstance(contains, list) else ()):
        at = ("contains", index)
        if not isinstance(name, str):
            continue
        path = yield from parsed.attempt(at, partial(inside, folder, name, "contains"))
        if path is not None and not path.exists():
            yield parsed.problem(at, f"{name} is listed but missing; copy the capture again")
    if about is not None and about.distance_m is not None:
        place, far_m = parsed.at(("distance_m",)), abs(about.distance_m)
        yield from findings(place, "length", name="distance_m is", far_m=far_m, most_m=FAR_M)
    if about is not None and about.box_m is not None:
        place, far_m = parsed.at(("box_m",)), max(map(abs, about.box_m))
        yield from findings(place, "box", box_m=list(about.box_m))
        yield from findings(place, "length", name="box_m reaches", far_m=far_m, most_m=FAR_M)
    methods = parsed.values.get("methods")
    for id, values in methods.items() if isinstance(methods, dict) else ():
        yield from method_problems(parsed, id, values, ("methods", id), ("methods", id))
    return about


def method_problems(
    parsed: ParsedFile, id: str, values: Any, at_id: Location, at_values: Location
) -> Found[Config | None]:
    """Yield the problems of a method's id and of its configuration. Returns the configuration if
    there are none, else None. at_id, at_values: places of both in the file."""
    chosen = yield from parsed.attempt(at_id, lambda: method(id))
    return (
        None if chosen is None else (yield from parsed.complaints(chosen.config, values, at_values))
    )


def _echoes(file: Path, capture: NativeCapture) -> Found[RadarCapture | None]:
    echoes = yield from attempt(file, partial(capture.echoes, calibrated=False))
    if echoes is None:
        return None
    calibration, empty = capture.folder / ARRAY, capture.folder / EMPTY
    yield from attempt(calibration, lambda: with_calibration(echoes, calibration))
    if empty.exists():
        yield from attempt(empty, lambda: load_capture(empty))
    yield from warnings_at(file, echo_warnings(echoes))
    return echoes


def _truths(capture: NativeCapture, echoes: RadarCapture | None) -> tuple[Path, ...]:
    """Return the files of the true surface at the start of each frame. Raises HandbenchError if
    their number is not that of the frames."""
    frames = 0 if echoes is None else len(echoes.samples)
    files = capture.truths(frames)
    if files and len(there := sorted((capture.folder / TRUTHS).glob("*.ply"))) > frames:
        raise HandbenchError(
            f"{capture.folder / TRUTHS}: has {len(there)} surfaces, but the capture has {frames} "
            "frames; expected a true surface for each of them; make the capture again"
        )
    return files


def surface_problems(file: Path) -> Found[Surface | None]:
    """Yield the problems of a surface's file. Returns the surface (None: unreadable)."""
    surface = yield from attempt(file, lambda: read_surface(file))
    yield from warnings_at(file, surface_warnings(surface) if surface else ())
    return surface


def _target(file: Path) -> Iterator[Problem]:
    found, target = yield from parse_model(Target, file, "a calibration target description")
    for index, element in enumerate(target.element if target is not None else ()):
        far_m = max(map(abs, element.centre_m))
        place = found.at(("element", index, "centre_m"))
        yield from findings(place, "length", name="centre_m is", far_m=far_m, most_m=FAR_M)


def photo_problems(folder: Path, scaled: bool = True) -> Iterator[Problem]:
    """Yield all problems of a folder of photographs, of its cameras.json and of its board.toml.

    scaled: whether one of these two files must give the scale; if not, its absence is only a
    warning.
    """
    photos = yield from attempt(folder, lambda: find_photos(folder))
    described, cameras = folder / "board.toml", folder / "cameras.json"
    board, known = None, None
    if described.exists():
        _, board = yield from parse_model(Board, described, "an ArUco board description")
    posed = 0
    if cameras.exists():
        _, read = yield from parse_model(CameraFile, cameras, 'a cameras file {"cameras": [...]}')
        posed = (
            sum(camera.R is not None and camera.t is not None for camera in read.cameras)
            if read
            else 0
        )
        if read is not None and photos is not None:
            known = yield from attempt(cameras, partial(cameras_of, photos, cameras))
    yield from findings(folder, "photographs", needed=scaled, board=described.exists(), posed=posed)
    yield from warnings_at(
        described, board_warnings(photos or (), board, known or ()) if board else ()
    )


def board_warnings(
    photos: Sequence[Photo], board: Board, cameras: Sequence[Camera] = ()
) -> list[str]:
    """Return a warning, in a list, if the description of a board seems to be in a wrong unit.

    The unit seems wrong if the board's corners are implausibly far away, or if the first photograph
    that shows the board was taken from an implausible distance. cameras: give the focal length;
    without them, the one stored in the photograph is used.
    """
    from handbench.groundtruth.board.markers import detect_corners, focal_length_px

    corners_m = {
        (id, k): corner for id, quad in board.corners_m().items() for k, corner in enumerate(quad)
    }
    if far := list(warnings_of("board", {"far_m": float(np.abs(list(corners_m.values())).max())})):
        return far
    for photo, camera in zip_longest(photos[:LOOKED_AT], cameras[:LOOKED_AT]):
        seen = detect_corners(photo, board)
        if len(seen) < FEWEST_SEEN:
            continue
        focal_px = (
            camera.params[0] if camera else photo.focal_px or focal_length_px(photo, seen, board)
        )
        board_m, seen_px = (
            np.linalg.norm(np.std(of, axis=0))
            for of in ([corners_m[at] for at in seen], [*seen.values()])
        )
        distance_m = (focal_px or max(photo.width, photo.height)) * float(board_m / seen_px)
        return list(
            warnings_of("photograph of a board", {"photo": photo.name, "distance_m": distance_m})
        )
    return []
