"""COLMAP's binary models, walked through once: its own reader believes every count in them, and counts for ever."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path

from groundtruth.cameras.cameras import pycolmap
from radar.support.errors import HandbenchError

Skip = Callable[[bytes, int], int]  # (content, where a record begins) → where it ends


def check_model(folder: Path) -> None:
    """A HandbenchError where a binary file of a model is not exactly as long as what it counts."""
    for name, skip in SKIPS.items():
        file = folder / f"{name}.bin"
        if not file.is_file():
            continue
        content = file.read_bytes()
        try:
            at = _end(content, 0, "<Q", skip)
        except (struct.error, ValueError, KeyError):
            at = -1
        if at != len(content):
            raise HandbenchError(
                f"{folder}: is not readable as a COLMAP model ({file.name}: its {len(content)} bytes are not what it "
                "counts); copy it again"
            )


def write_model(model: pycolmap.Reconstruction, folder: Path) -> None:
    """Write a model, binary; an OSError where it was cut short, which COLMAP passes over in silence."""
    model.write_binary(folder)
    try:
        check_model(folder)
    except HandbenchError as error:
        raise OSError("COLMAP's model was cut short; is there space left on the disk?") from error


def _end(content: bytes, at: int, count: str, skip: Skip) -> int:
    """End of a list that begins with the number of its records."""
    (number,), at = struct.unpack_from(count, content, at), at + struct.calcsize(count)
    for _ in range(number):
        at = skip(content, at)
        if at > len(content):
            raise ValueError("cut short")
    return at


def _camera(content: bytes, at: int) -> int:
    model = struct.unpack_from("<i", content, at + 4)[0]
    return at + 24 + 8 * _parameters()[model]


@cache
def _parameters() -> dict[int, int]:
    """Number of parameters of each of COLMAP's lens models, by the model's number."""
    models = [model for name, model in pycolmap.CameraModelId.__members__.items() if name != "INVALID"]
    return {int(model): len(pycolmap.Camera.create_from_model_id(1, model, 1.0, 1, 1).params) for model in models}


def _image(content: bytes, at: int) -> int:
    name = content.index(b"\0", at + 64) + 1
    return _fixed(24, "<Q")(content, name)


def _fixed(size: int, count: str) -> Skip:
    """A list of records of one size."""

    def skip(content: bytes, at: int) -> int:
        return at + struct.calcsize(count) + size * struct.unpack_from(count, content, at)[0]

    return skip


def _point(content: bytes, at: int) -> int:
    return _fixed(8, "<Q")(content, at + 43)


def _rig(content: bytes, at: int) -> int:
    sensors = struct.unpack_from("<I", content, at + 4)[0]
    at += 8 + (8 if sensors else 0)  # the first is the reference, and has no pose
    for _ in range(1, sensors):
        if at + 9 > len(content):
            raise ValueError("cut short")
        at += 9 + (56 if content[at + 8] else 0)
    return at


def _frame(content: bytes, at: int) -> int:
    return _fixed(16, "<I")(content, at + 64)


SKIPS: dict[str, Skip] = {"cameras": _camera, "images": _image, "points3D": _point, "rigs": _rig, "frames": _frame}
