"""One way to open captures and transforms of any data set: the files in a folder decide which class
reads it."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from handbench.bench.datasets.mapping import MappedCapture
from handbench.bench.datasets.maroon import (
    ALIGNMENT,
    METADATA,
    REGISTRATIONS,
    MaroonCapture,
    load_alignment,
)
from handbench.bench.datasets.native import (
    DESCRIPTION,
    ECHOES,
    EMPTY_FILTERED,
    MAPPING,
    MESH,
    PHOTOS,
    TRANSFORM,
    TRUTH,
    NativeCapture,
    save_capture_file,
)
from handbench.bench.datasets.ti import import_ti_raw
from handbench.bench.datasets.touchstone import import_touchstone
from handbench.calibration.transforms import Transform, identity, load_transform
from handbench.groundtruth.mesh.surface import read_mesh, write_mesh
from handbench.radar.data.echoes_file import save_capture
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, require_folder

KNOWN = f"{DESCRIPTION} (handbench), {MAPPING} (other programs) or radar_*/calibrated_data (MAROON)"
# the captures that are read from their own folders, by the name of their data set
FOREIGN: dict[str, type[NativeCapture]] = {"mapping": MappedCapture, "maroon": MaroonCapture}
# what converts other data with settings to a capture folder: function(source, folder, **settings)
IMPORTERS: dict[str, Callable[..., None]] = {
    "touchstone": import_touchstone,
    "ti-raw": import_ti_raw,
}
# a file in a folder that has to be imported → the name of its data set
RAW = {"positions.csv": "touchstone", "adc_data*.bin": "ti-raw"}
# behind a MAROON capture's path: its frames without the empty room
AT_EMPTY_FILTERED = f"@{EMPTY_FILTERED}"
DEPTH = 3  # folders below a data set's root in which captures are looked for


def open_capture(path: str | Path) -> NativeCapture:
    """Open the capture in a folder, of any data set; the files in the folder decide how it is read.

    The path of a MAROON capture may end in @emptyfiltered, which selects the frames from which the
    empty room was subtracted. Raises HandbenchError if the folder is not a capture; the message
    lists the files that were expected.
    """
    name = str(Path(path))
    empty_filtered = name.endswith(AT_EMPTY_FILTERED)
    folder = require_folder(name.removesuffix(AT_EMPTY_FILTERED), "a capture")
    reader = _reader(folder)
    if reader is None:
        hints = [
            f"; it contains captures, so name one of them, such as {capture}"
            for capture in sorted(_below(folder))[:1]
        ]
        raise HandbenchError(f"{folder}: is not a capture; {_expected(folder)}{''.join(hints)}")
    if reader is MaroonCapture:
        return MaroonCapture(folder, empty_filtered)
    if empty_filtered:
        raise HandbenchError(
            f"{path}: only captures of MAROON have frames {AT_EMPTY_FILTERED}; leave this ending "
            "out"
        )
    return reader(folder)


def _expected(folder: Path) -> str:
    """Say which files make a capture, and which command makes one of a folder's raw data."""
    hints = [
        f"; it looks like data of {kind}, so run `handbench import {kind}` first"
        for files, kind in RAW.items()
        if any(folder.glob(files))
    ]
    return f"expected {KNOWN}{''.join(hints)}"


def has_capture(folder: Path) -> bool:
    """Tell whether a folder is a capture, or has one below it."""
    return bool(_below(folder))


def _reader(folder: Path) -> type[NativeCapture] | None:
    """Return the class that reads the capture in a folder; None if there is no capture."""
    readers: list[type[NativeCapture]] = [NativeCapture, *FOREIGN.values()]
    return next((reader for reader in readers if reader.fits(folder)), None)


def captures(
    root: str | Path, objects: Sequence[str] = (), distances: Sequence[int] = ()
) -> list[Path]:
    """Find the folders of all captures below a data set's root, and return them sorted, with 30
    before 100, and numbers before other names.

    Folders are named ROOT/OBJECT or ROOT/OBJECT/DISTANCE. objects, distances: keep only these
    (empty: all). Two kinds of MAROON folders are left out: captures that register its sensors, and
    captures of rooms without an object, which have no metadata.json. Raises HandbenchError if an
    object does not exist, or if no capture is left.
    """
    root = require_folder(root, "a data set")
    places = {folder: folder.relative_to(root).parts for folder in _below(root)}
    if not places:
        raise HandbenchError(f"{root}: contains no capture; {_expected(root)}")
    known = sorted({name for place in places.values() for name in place[:1]})
    for name in objects:
        if name not in known:
            raise HandbenchError(
                f"{root}: has no captures of an object '{name}'; {suggest(name, known)}"
            )
    chosen = [
        folder
        for folder, place in places.items()
        if (not objects or {*place[:1]} & {*objects})
        and (not distances or folder.name in map(str, distances))
    ]
    if not chosen:
        there = ", ".join(sorted({folder.name for folder in places})[:12])
        raise HandbenchError(
            f"{root}: none of its captures is selected; the folders with captures are: {there}; "
            "select at least one"
        )
    return sorted(
        chosen,
        key=lambda folder: [
            (int(name) if name.isdecimal() else 10**9, name) for name in places[folder]
        ],
    )


def _below(folder: Path, depth: int = DEPTH) -> list[Path]:
    """Return the folders of captures in a folder, at most so many levels below it."""
    reader = _reader(folder)
    if reader is not None:
        return [folder] if reader is not MaroonCapture or (folder / METADATA).is_file() else []
    return [
        capture
        for inner in folder.iterdir()
        if depth and inner.is_dir() and not inner.name.startswith((".", REGISTRATIONS))
        for capture in _below(inner, depth - 1)
    ]


def load_any_transform(file: str | Path | None) -> Transform:
    """Read a transform to the radar frame from a file in handbench's format or, if the file is
    named alignment.json, in MAROON's.

    file: None returns the identity, for points that are in the radar frame already. Raises
    HandbenchError for a file in neither format.
    """
    if file is None:
        return identity("radar")
    if not isinstance(file, str | Path):
        raise HandbenchError("transform: is no path; expected a Transform, or a file of one")
    file = Path(file)
    transform = load_alignment(file) if file.name == ALIGNMENT else load_transform(file)
    return transform.require(transform.source, "radar", file)


# names of the files of an imported capture
IMPORTED = (DESCRIPTION, ECHOES, MESH, TRUTH, TRANSFORM, f"{PHOTOS}/*")


def import_capture(kind: str, path: Path, folder: Path, /, **settings: Any) -> None:
    """Convert a capture of another format to a capture folder, which appears complete or not at
    all.

    kind: format of the capture, one of FOREIGN or IMPORTERS. path: the capture. folder: the folder
    to make. It receives the echoes of all frames, the measured mesh (without one, the photographs),
    the transform, the true surface and the description, as far as the capture has them. settings:
    of the importer. Raises HandbenchError for an unknown or another format.
    """
    if kind in IMPORTERS:
        IMPORTERS[kind](path, folder, **settings)
        return
    if kind not in FOREIGN:
        raise HandbenchError(f"dataset: unknown '{kind}'; {suggest(kind, [*FOREIGN, *IMPORTERS])}")
    if settings:
        raise HandbenchError(f"--set: the data set '{kind}' has no settings; leave --set out")
    capture = open_capture(path)
    if not isinstance(capture, FOREIGN[kind]):
        raise HandbenchError(
            f"{path}: is not a capture of '{kind}'; every command reads it as it is"
        )
    about, mesh, transform = capture.about, capture.mesh(), capture.transform()
    with atomic_folder(folder) as temporary:
        save_capture(temporary / ECHOES, capture.echoes())
        for file, name in ((mesh, MESH), (capture.truth, TRUTH)):
            if file is not None and file.suffix.lower() == ".ply":
                shutil.copyfile(file, temporary / name)  # with what its vertices carry
            elif file is not None:
                write_mesh(temporary / name, read_mesh(file))
        if mesh is None and capture.photos is not None:
            shutil.copytree(capture.photos, temporary / PHOTOS)
        if transform is not None:
            transform.save(temporary / TRANSFORM)
        contains = tuple(sorted(file.name for file in temporary.iterdir()))
        save_capture_file(temporary, about.model_copy(update={"contains": contains}))
