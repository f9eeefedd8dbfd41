"""Corrections of a capture that were estimated from its own echoes: the file `corrections.json`
beside them, and its application when they are read."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from handbench.calibration.echoes.channels import CaptureChannels
from handbench.radar.data.arrays import BistaticScan, PlanarScan
from handbench.radar.data.capture import RadarCapture
from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json

Unknown = Literal["range_offset", "scan_step", "gains"]  # what echoes tell of the instrument
Metres = Annotated[float, Field(ge=-1e3, le=1e3)]
Factor = Annotated[float, Field(ge=0.1, le=10)]
Part = Annotated[float, Field(ge=-1e6, le=1e6)]


class Corrections(Config):
    """The content of `corrections.json`.

    range_offset_m: by how much every target appears too far away, since the instrument and its
    cables delay the echo. scan_step: factors of the scan's steps along x and y. gains: [re, im] of
    the transmitters and of the receivers of an array, or of the elements of a moved one, in the
    order of `CaptureChannels.sides`; empty if they were not estimated.
    """

    format: Literal["handbench-corrections"] = "handbench-corrections"
    version: Literal[1] = 1
    range_offset_m: Metres = 0.0
    scan_step: tuple[Factor, Factor] = (1.0, 1.0)
    gains: tuple[tuple[tuple[Part, Part], ...], ...] = ()

    def applied_to(self, capture: RadarCapture, where: str) -> RadarCapture:
        """Return a corrected capture: its samples have no range offset and are divided by the
        gains, and the antennas of a scan are where its true steps take them. where: the
        file, which a HandbenchError names if the corrections are of a capture with other
        channels."""
        channels = CaptureChannels.of(capture.aperture)
        waves = capture.frequencies_hz / capture.wave_speed_m_s
        factor = np.exp(4j * np.pi * waves * self.range_offset_m)[:, None] / self.gain(
            channels, where
        )
        samples = capture.samples * factor.reshape(-1, *capture.aperture.channels)
        aperture = capture.aperture
        if isinstance(aperture, PlanarScan | BistaticScan):
            shift_m = channels.moves_m * np.array([*self.scan_step, 1.0]) - channels.moves_m
            aperture = replace(
                aperture, **{name: place_m + shift_m for name, place_m in vars(aperture).items()}
            )
        elif self.scan_step != (1.0, 1.0):
            raise HandbenchError(
                f"{where}: has scan_step {self.scan_step}, but an array is not moved; remove it"
            )
        return replace(capture, samples=samples.astype(np.complex64), aperture=aperture)

    def gain(self, channels: CaptureChannels, where: str) -> np.ndarray:
        """Compute the gain of each channel, complex [n]. Raises HandbenchError, which begins with
        `where`, for gains of other channels and for gains of 0."""
        if not self.gains:
            return np.ones(len(channels.tx_m), np.complex128)
        counts = [len(side) for side in self.gains]
        if counts != [side.count for side in channels.sides] or not all(
            any(gain) for side in self.gains for gain in side
        ):
            raise HandbenchError(
                f"{where}: has {counts} gains; expected {[side.count for side in channels.sides]}, "
                "none of them 0; estimate them again: handbench calibrate CAPTURE --from-echoes"
            )
        return channels.spread([np.array(side) @ [1, 1j] for side in self.gains])


def with_corrections(capture: RadarCapture, file: Path) -> tuple[RadarCapture, str]:
    """Apply to a capture the corrections in `file` (a `corrections.json`). Returns the new capture
    and a message that says what was applied; without the file, the capture unchanged and "". Raises
    HandbenchError if the corrections do not fit."""
    if not file.exists():
        return capture, ""
    corrections = parse(Corrections, read_json(file, "corrections of a capture"), str(file))
    done = [f"range offset {1e3 * corrections.range_offset_m:+.1f} mm"]
    if corrections.scan_step != (1.0, 1.0):
        done.append("scan step × {:.4f} (x), {:.4f} (y)".format(*corrections.scan_step))
    if corrections.gains:
        done.append(f"{sum(map(len, corrections.gains))} gains")
    return corrections.applied_to(capture, str(file)), f"{file}: applied: {', '.join(done)}"
