"""Capture folders: handbench's own format for the data of one scene."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomlkit
from pydantic import Field, field_validator

from handbench.calibration.array_file import with_calibration
from handbench.calibration.corrections import Unknown, with_corrections
from handbench.calibration.transforms import Transform, load_transform
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.radar.simulation.scene import Choice
from handbench.support.config import Config, Name, load, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, content_hash, inside, require_file, write_text
from handbench.support.progress import say

DESCRIPTION = "capture.toml"
MAPPING = "mapping.toml"  # the description of a capture in other programs' files
EMPTY_FILTERED = "emptyfiltered"  # frames of MAROON from which their empty room has been taken
ECHOES, TRUTH, MESH, PHOTOS = "echoes.h5", "truth.ply", "mesh.ply", "photos"
TRUTHS = "truth"  # folder with the true surface at the start of each frame, NNN.ply
ARRAY = "array.json"  # calibration of the antennas
CORRECTIONS = "corrections.json"  # of the instrument, from the capture's own echoes
EMPTY = "empty.h5"  # the room without the target
TRANSFORM, TARGET = "radar_from_photo.json", "target.toml"
TRUE_TRANSFORM = "truth_radar_from_photo.json"  # of a simulated capture
INSPECTION = "warnings.json"  # of a run's stage that inspects it
FAR_M = 10.0  # further than anything near-field: a number of millimetres, most likely


class CaptureFile(Config):
    """The content of `capture.toml`, which describes a capture in its folder.

    kind: of the target. pose: a letter of the manual alphabet or "free", for hands. contains: names
    of the folder's other files. source: where the data are from, in words.
    """

    version: Literal[1] = 1
    name: Name
    kind: Literal["hand", "target", "scan", "other"] = "hand"
    pose: str | None = None
    distance_m: float | None = None
    units: Literal["m"] = "m"
    seed: int | None = None
    box_m: tuple[float, float, float, float, float, float] | None = Field(
        default=None,
        description="xmin, ymin, zmin, xmax, ymax, zmax in the photo frame: what is scored",
    )
    contains: tuple[str, ...] = Field(default=(), max_length=1000)
    unknown: tuple[Unknown, ...] = Field(
        default=(),
        description="of the instrument: what handbench calibrate --from-echoes estimates",
    )
    source: str | None = None
    effects: tuple[Choice, ...] = Field(
        default=(), description="of a simulated capture: what its echoes show"
    )
    methods: dict[str, dict[str, Any]] = Field(
        default_factory=dict,
        description="configuration per method id where this sensor needs another than the default",
    )

    @field_validator("box_m")
    @classmethod
    def _ascending(cls, box_m: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if box_m and any(low >= high for low, high in zip(box_m[:3], box_m[3:], strict=True)):
            raise ValueError("expected xmin, ymin, zmin, then the larger xmax, ymax, zmax")
        return box_m


def save_capture_file(folder: Path, description: CaptureFile) -> None:
    """Write a capture's description to `capture.toml` in its folder, atomically."""
    write_text(folder / DESCRIPTION, tomlkit.dumps(description.model_dump(exclude_none=True)))


def save_echoes_folder(folder: str | Path, capture: RadarCapture, facts: Mapping[str, Any]) -> None:
    """Write a capture folder that has only echoes and their description, atomically. facts: fields
    of `CaptureFile`; without a name, it gets that of the folder."""
    with atomic_folder(folder) as temporary:
        facts = {"name": Path(folder).resolve().name, "contains": (ECHOES,)} | dict(facts)
        description = parse(CaptureFile, facts, str(folder))
        save_capture(temporary / ECHOES, capture)
        save_capture_file(temporary, description)


@dataclass(frozen=True)
class NativeCapture:
    """One capture in handbench's own format; subclasses read other formats.

    Methods and properties that return a path or a transform return None if the capture has none.
    """

    folder: Path

    @staticmethod
    def fits(folder: Path) -> bool:
        """Tell whether `folder` has a capture.toml, so that this class can read it."""
        return (folder / DESCRIPTION).is_file()

    @cached_property
    def about(self) -> CaptureFile:
        """The description of the capture, from its `capture.toml`. Raises HandbenchError if this
        file, or a file that it lists, is missing."""
        description = load(CaptureFile, self.folder / DESCRIPTION, "a capture description")
        missing = [
            f"{self.folder}: {name} is missing, although {DESCRIPTION} lists it; copy the capture "
            "again"
            for name in description.contains
            if not inside(self.folder, name, DESCRIPTION).exists()
        ]
        if missing:
            raise HandbenchError(missing[0], missing)
        return description

    def echoes(self, frames: int | None = None, calibrated: bool = True) -> RadarCapture:
        """Read the echoes of the first `frames` frames (None: all).

        calibrated: apply the calibration of the antennas, if there is one (in `array.json` next to
        the echoes, or in their file), then the capture's corrections (`corrections.json`), and
        print a line about each.
        """
        echoes = self._recorded().first_frames(frames)
        if calibrated:
            for corrected, file in ((with_calibration, ARRAY), (with_corrections, CORRECTIONS)):
                echoes, message = corrected(echoes, self.folder / file)
                if message:
                    say(message)
        return echoes

    def _recorded(self) -> RadarCapture:
        """Read the echoes of all frames as they were recorded."""
        return load_capture(self.folder / ECHOES)

    @property
    def photos(self) -> Path | None:
        """The folder of the capture's photographs; None if there is none."""
        return self._lying(PHOTOS)

    def mesh(self) -> Path | None:
        """Return the file (PLY, OBJ or STL) of the measured surface in the photo frame, metres;
        None if there is none."""
        return self._lying(MESH)

    @property
    def truth(self) -> Path | None:
        """The file of the true surface in the radar frame, metres; None if it is unknown."""
        return self._lying(TRUTH)

    def truths(self, frames: int) -> tuple[Path, ...]:
        """Return the files of the true surface in the radar frame at the start of each frame; () if
        the capture has none, because one surface is valid for all frames.

        frames: how many are needed. Raises HandbenchError if there are fewer."""
        if not (self.folder / TRUTHS).is_dir():
            return ()
        what = f"a true surface at the start of each of {frames} frames"
        files = (self.folder / TRUTHS / f"{frame:03d}.ply" for frame in range(frames))
        return tuple(require_file(file, what) for file in files)

    def transform(self) -> Transform | None:
        """Read the transform from the photo frame to the radar frame; None if the capture has
        none."""
        file = self._lying(TRANSFORM)
        return load_transform(file).require("photo", "radar", file) if file else None

    def surface(self) -> Surface | None:
        """Read the surface in the radar frame: the true one, else the measured one if the capture
        has the transform of its frame; None if it has neither."""
        if self.truth is not None:
            return read_surface(self.truth)
        mesh, transform = self.mesh(), self.transform()
        return None if mesh is None or transform is None else read_surface(mesh).moved(transform)

    def warnings(self) -> list[str]:
        """Return warnings of likely mistakes in files that only this data set has; none for
        handbench's own format."""
        return []

    def mask(self, depth: DepthMap, erode: bool = False) -> np.ndarray:
        """Return the mask [ny, nx] of the pixels of a depth map that the data set scores: here, all
        pixels that have a depth. erode: also remove the target's edges, if the data set defines
        how; here without effect."""
        return np.isfinite(depth.z_m)

    def key(self, frames: int | None = None) -> str:
        """Return a hash of everything that a run over the first `frames` frames (None: all) may
        read: here, of the whole folder."""
        return content_hash(self.folder)

    def _lying(self, name: str) -> Path | None:
        path = self.folder / name
        return path if path.exists() else None
