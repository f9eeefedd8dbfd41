"""Captures of any data set through one interface: the files in a folder decide which adapter reads
it."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from handbench.bench.datasets.mapped_capture import MAPPING, MappedCapture
from handbench.bench.datasets.maroon import EMPTY_FILTERED, METADATA, REGISTRATIONS, MaroonCapture
from handbench.bench.datasets.native import (
    DESCRIPTION,
    ECHOES,
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

ADAPTERS = (NativeCapture, MappedCapture, MaroonCapture)
# what can be imported, by the name of its data set
FOREIGN = {"maroon": MaroonCapture, "mapping": MappedCapture}
KNOWN = f"{DESCRIPTION} (handbench), {MAPPING} (other programs) or radar_*/calibrated_data (MAROON)"
# a file in a folder that has to be imported → the name of its data set
RAW = {"scan.npy": "planar_scan", "positions.csv": "touchstone", "adc_data.bin": "ti-raw"}
# behind a MAROON capture's path: its frames without the empty room
AT_EMPTY_FILTERED = f"@{EMPTY_FILTERED}"
DEPTH = 3  # folders below a data set's root in which captures are looked for


def open_capture(path: str | Path) -> NativeCapture:
    """Open the capture in a folder, of whatever data set; the files in it decide how it is read.
    A MAROON capture's path may end in @emptyfiltered: its frames without the empty room. Raises
    HandbenchError if the folder is no capture; the message lists the files it expected."""
    path = Path(path)
    asked = path.name.endswith(AT_EMPTY_FILTERED)
    folder = require_folder(
        path.with_name(path.name.removesuffix(AT_EMPTY_FILTERED)) if asked else path, "a capture"
    )
    adapter = _adapter(folder)
    if adapter is None:
        kind = next((kind for name, kind in RAW.items() if (folder / name).exists()), None)
        hint = f"; {kind}: run `handbench import {kind}`" if kind else ""
        below = _below(folder, DEPTH)
        hint = f"; it has captures in it: name one, as {min(below)}" if below else hint
        raise HandbenchError(f"{folder}: is no capture; expected {KNOWN}{hint}")
    if asked and adapter is not MaroonCapture:
        raise HandbenchError(
            f"{path}: only captures of MAROON have frames {AT_EMPTY_FILTERED}; leave it out"
        )
    return MaroonCapture(folder, empty_filtered=True) if asked else adapter(folder)


def _adapter(folder: Path) -> type[NativeCapture] | None:
    return next((adapter for adapter in ADAPTERS if adapter.fits(folder)), None)


def captures(
    root: str | Path, objects: Sequence[str] = (), distances: Sequence[int] = ()
) -> list[Path]:
    """Find the folders of captures below a data set's root: a sorted list.
    Folders are named ROOT/OBJECT or ROOT/OBJECT/DISTANCE; objects, distances: keep only these
    (empty: all). Left out are the captures with which MAROON registers its sensors, and rooms
    without an object, which have no metadata.json. Raises HandbenchError for a missing object and
    when nothing is left."""
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
        there = ", ".join(sorted({folder.name for folder in found})[:12]) or "none at all"
        raise HandbenchError(
            f"{root}: has no capture that was asked for; folders with captures: {there}"
        )
    return chosen


def _below(folder: Path, depth: int) -> list[Path]:
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
    """Sort key that puts 30 before 100, and numbers before names."""
    return (int(name), name) if name.isdecimal() else (10**9, name)


# names of the files of an imported capture
IMPORTED = (DESCRIPTION, ECHOES, MESH, TRUTH, TRANSFORM, f"{PHOTOS}/*")


def import_capture(kind: str, path: str | Path, folder: str | Path) -> None:
    """Write a capture of another form as a capture folder of handbench, all or nothing.
    kind: "maroon" or "mapping". path: the capture; folder: the one to make. It gets the echoes of
    all frames, the measured mesh or else the photographs, the transform, the true surface and the
    description. Raises HandbenchError if the capture is of another kind, or mirrored."""
    capture = open_capture(path)
    if not isinstance(capture, FOREIGN[kind]):
        raise HandbenchError(
            f"{path}: is no capture of '{kind}' but of {type(capture).__name__}; name the right "
            "kind"
        )
    about, mesh, transform = capture.about, capture.mesh(), capture.transform()
    if transform is not None and transform.scale < 0:
        raise HandbenchError(
            f"{path}: {transform.note}; a capture folder cannot record that: use the "
            "original folder"
        )
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
