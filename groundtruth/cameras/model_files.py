"""COLMAP's binary models, walked through once: its own reader believes every count in them, and counts for ever."""

import struct
from functools import cache
from pathlib import Path

from handbench.groundtruth.cameras.cameras import pycolmap
from handbench.support.errors import HandbenchError
from handbench.support.files import read_bytes, require_size
from handbench.support.limits import MODEL_BYTES

KINDS = ("cameras", "images", "points3D", "rigs", "frames")


def check_model(folder: Path) -> None:
    """A HandbenchError where a binary file of a model is not exactly as long as what it counts, or one is too large."""
    for name in KINDS:
        file = folder / f"{name}.bin"
        if not file.is_file():
            if (text := file.with_suffix(".txt")).is_file():
                require_size(text, "a part of a COLMAP model", MODEL_BYTES)
            continue
        content = read_bytes(file, "a part of a COLMAP model", MODEL_BYTES)
        try:
            end = _length(content, name)
        except (struct.error, ValueError, KeyError):
            end = -1
        if end != len(content):
            raise HandbenchError(
                f"{folder}: is not readable as a COLMAP model ({file.name}: its {len(content)} bytes are not what it "
                "counts); copy it again"
            )


def write_model(model: "pycolmap.Reconstruction", folder: Path) -> None:
    """Write a model, binary; an OSError where it was cut short, which COLMAP passes over in silence."""
    model.write_binary(folder)
    try:
        check_model(folder)
    except HandbenchError as error:
        raise OSError("COLMAP's model was cut short; is there space left on the disk?") from error


def _length(content: bytes, kind: str) -> int:
    """End of the records of a file, whose number stands at its head; struct.error, ValueError or KeyError where they
    go beyond it, or name a lens model that there is not."""

    def number(form: str, at: int) -> int:
        return int(struct.unpack_from(form, content, at)[0])

    end = 8
    for _ in range(number("<Q", 0)):
        match kind:
            case "cameras":
                end += 24 + 8 * _parameters()[number("<i", end + 4)]
            case "images":
                end = content.index(b"\0", end + 64) + 1
                end += 8 + 24 * number("<Q", end)
            case "points3D":
                end += 51 + 8 * number("<Q", end + 43)
            case "rigs":
                sensors = number("<I", end + 4)
                end += 16 if sensors else 8  # the first is the reference, and has no pose
                for _ in range(1, sensors):
                    end += 65 if number("B", end + 8) else 9
            case "frames":
                end += 68 + 16 * number("<I", end + 64)
        if end > len(content):
            raise ValueError("cut short")
    return end


@cache
def _parameters() -> dict[int, int]:
    """Number of parameters of each of COLMAP's lens models, by the model's number."""
    models = [model for name, model in pycolmap.CameraModelId.__members__.items() if name != "INVALID"]
    return {int(model): len(pycolmap.Camera.create_from_model_id(1, model, 1.0, 1, 1).params) for model in models}
