"""One way to open captures of any data set: the files in a folder decide which class reads it."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

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
from handbench.groundtruth.mesh.mesh_files import read_mesh, write_mesh
from handbench.radar.data.echoes_file import save_capture
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, require_folder

KNOWN = f"{DESCRIPTION} (handbench), {MAPPING} (other programs) or radar_*/calibrated_data (MAROON)"
# a file in a folder that has to be imported → the name of its data set
RAW = {"positions.csv": "touchstone", "adc_data.bin": "ti-raw"}
# behind a MAROON capture's path: its frames without the empty room
AT_EMPTY_FILTERED = f"@{EMPTY_FILTERED}"
DEPTH = 3  # folders below a data set's root in which captures are looked for


def open_capture(path: str | Path) -> NativeCapture:
    """Open the capture in a folder, of any data set; the files in the folder decide how it is read.

    The path of a MAROON capture may end in @emptyfiltered, which selects the frames from which the
    empty room was subtracted. Raises HandbenchError if the folder is not a capture; the message
    lists the files that were expected.
    """
    path = Path(path)
    asked = path.name.endswith(AT_EMPTY_FILTERED)
    folder = require_folder(
        path.with_name(path.name.removesuffix(AT_EMPTY_FILTERED)) if asked else path, "a capture"
    )
    adapter = _adapter(folder)
    if adapter is None:
        kind = next((kind for name, kind in RAW.items() if (folder / name).exists()), None)
        hint = (
            (f"; it looks like data of {kind}, so run `handbench import {kind}` first")
            if kind
            else ""
        )
        below = _below(folder, DEPTH)
        hint = (
            (f"; it contains captures, so name one of them, such as {min(below)}")
            if below
            else hint
        )
        raise HandbenchError(f"{folder}: is not a capture; expected {KNOWN}{hint}")
    if not asked:
        return adapter(folder)
    from handbench.bench.datasets.maroon import MaroonCapture

    if adapter is not MaroonCapture:
        raise HandbenchError(
            f"{path}: only captures of MAROON have frames {AT_EMPTY_FILTERED}; leave this ending "
            "out"
        )
    return MaroonCapture(folder, empty_filtered=True)


def _adapter(folder: Path) -> type[NativeCapture] | None:
    """Return the class that reads the capture in a folder; None if there is no capture."""
    if NativeCapture.fits(folder):
        return NativeCapture
    return next((other for other in foreign().values() if other.fits(folder)), None)


def foreign() -> dict[str, type[NativeCapture]]:
    """Return the classes of the captures that can be imported, by the name of their data set. They
    are imported here, because their import takes as long as that of all other readers."""
    from handbench.bench.datasets.mapped_capture import MappedCapture
    from handbench.bench.datasets.maroon import MaroonCapture

    return {"mapping": MappedCapture, "maroon": MaroonCapture}


def importers() -> dict[str, Callable[[Path, Path, dict[str, Any]], None]]:
    """Return the functions that convert data with settings to a capture folder, by the name of
    their data set: function(source, folder, settings)."""
    from handbench.bench.datasets.ti import import_ti_raw
    from handbench.bench.datasets.touchstone import import_touchstone

    return {"touchstone": import_touchstone, "ti-raw": import_ti_raw}


def captures(
    root: str | Path, objects: Sequence[str] = (), distances: Sequence[int] = ()
) -> list[Path]:
    """Find the folders of all captures below a data set's root, and return them sorted.

    Folders are named ROOT/OBJECT or ROOT/OBJECT/DISTANCE. objects, distances: keep only these
    (empty: all). Two kinds of MAROON folders are left out: captures that register its sensors, and
    captures of rooms without an object, which have no metadata.json. Raises HandbenchError if an
    object does not exist, or if no capture is left.
    """
    root = require_folder(root, "a data set")
    found = sorted(
        _below(root, DEPTH),
        key=lambda folder: [_in_order(part) for part in folder.relative_to(root).parts],
    )
    known = {folder.relative_to(root).parts[0] for folder in found if folder != root}
    for name in objects:
        if name not in known:
            raise HandbenchError(
                f"{root}: has no captures of an object '{name}'; {suggest(name, sorted(known))}"
            )
    chosen = [
        folder
        for folder in found
        if (not objects or folder.relative_to(root).parts[:1] in {(name,) for name in objects})
        and (not distances or folder.name in {str(distance) for distance in distances})
    ]
    if not chosen:
        there = ", ".join(sorted({folder.name for folder in found})[:12]) or "none"
        raise HandbenchError(
            f"{root}: none of its captures is selected; the folders with captures are: {there}; "
            "select at least one"
        )
    return chosen


def _below(folder: Path, depth: int) -> list[Path]:
    from handbench.bench.datasets.maroon import METADATA, REGISTRATIONS, MaroonCapture

    adapter = _adapter(folder)
    if adapter is not None:
        return [folder] if adapter is not MaroonCapture or (folder / METADATA).is_file() else []
    inner = (
        []
        if depth == 0
        else [p for p in folder.iterdir() if p.is_dir() and not p.name.startswith(".")]
    )
    return [found for p in inner if p.name != REGISTRATIONS for found in _below(p, depth - 1)]


def _in_order(name: str) -> tuple[int, str]:
    """Return a sort key for a folder's name that puts 30 before 100, and numbers before other
    names."""
    return (int(name), name) if name.isdecimal() else (10**9, name)


# names of the files of an imported capture
IMPORTED = (DESCRIPTION, ECHOES, MESH, TRUTH, TRANSFORM, f"{PHOTOS}/*")


def import_capture(
    kind: str, path: str | Path, folder: str | Path, settings: dict[str, Any] | None = None
) -> None:
    """Convert a capture of another format to a capture folder, which appears complete or not at
    all.

    kind: format of the capture, one of `foreign` or `importers`. path: the capture. folder: the
    folder to make. It receives the echoes of all frames, the measured mesh (without one, the
    photographs), the transform, the true surface and the description, as far as the capture has
    them. settings: of the importer. Raises HandbenchError for an unknown or another format.
    """
    known = importers()
    if kind in known:
        known[kind](Path(path), Path(folder), settings or {})
        return
    if kind not in foreign():
        raise HandbenchError(f"dataset: unknown '{kind}'; {suggest(kind, [*foreign(), *known])}")
    if settings:
        raise HandbenchError(f"--set: the data set '{kind}' has no settings; leave --set out")
    capture = open_capture(path)
    if not isinstance(capture, foreign()[kind]):
        raise HandbenchError(
            f"{path}: is not a capture of '{kind}' but of {type(capture).__name__}; use the "
            "import for this kind"
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
