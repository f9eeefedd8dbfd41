"""Calibration of an array's antennas, as stored in the file `array.json`, and its application to
captures."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.support.config import Config, Tone, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json

SAME_M = 1e-7  # positions that agree to this are the same
Gain = Annotated[float, Field(ge=-100, le=100)]
Metres = Annotated[float, Field(ge=-10, le=10)]


class Side(Config):
    """Calibration of all transmitters, or of all receivers; every list has one entry per antenna.

    nominal_m: positions in captures; gain: [re, im] at the reference frequency, 0 for a dead
    antenna; delay_m: delay of the cable, as a path.
    """

    nominal_m: tuple[tuple[Metres, Metres, Metres], ...] = Field(min_length=1)
    gain: tuple[tuple[Gain, Gain], ...]
    delay_m: tuple[Metres, ...]

    @model_validator(mode="after")
    def _one_entry_per_antenna(self) -> "Side":
        for name, values in self:
            if len(values) != len(self.nominal_m):
                raise ValueError(
                    f"'{name}' has {len(values)} entries, but 'nominal_m' has "
                    f"{len(self.nominal_m)} antennas; give one entry for each antenna"
                )
        if not self.gains.any():
            raise ValueError(
                "every gain is 0, but at least one antenna must work; calibrate the array again"
            )
        return self

    @property
    def gains(self) -> np.ndarray:
        """Complex gains g [n] at the reference frequency."""
        return np.array(self.gain) @ [1, 1j]

    def response(self, frequencies_hz: np.ndarray, reference_hz: float) -> np.ndarray:
        """Compute the responses [f, n] of the antennas at the frequencies f [f], Hz: g·exp(−j2π(f −
        f₀)d/c) with the gains g, the delays d and the reference frequency f₀."""
        turns_per_m = (np.asarray(frequencies_hz) - reference_hz) / SPEED_OF_LIGHT_M_S
        return self.gains * np.exp(-2j * np.pi * np.multiply.outer(turns_per_m, self.delay_m))


class ArrayCalibration(Config):
    """The content of `array.json`: the calibration of an array's transmitters and receivers.

    source: name of the capture from which it was estimated; reference_hz: the frequency of the
    gains.
    """

    format: Literal["handbench-array"] = "handbench-array"
    version: Literal[1] = 1
    source: str
    reference_hz: Tone
    tx: Side
    rx: Side

    def applied_to(
        self, capture: RadarCapture, where: object = "array calibration"
    ) -> RadarCapture:
        """Return the capture with its samples divided by the responses of their transmitter and
        receiver, s[f, t, r] / (a_t(f)·b_r(f)), and without dead antennas.

        where: the calibration's file, named in messages. Raises HandbenchError if the capture's
        antennas are not at the nominal positions.
        """
        array = capture.aperture
        if not isinstance(array, AntennaArray):
            raise HandbenchError(
                f"{where}: is for an antenna array (MIMO), but the capture is a planar scan or a "
                "list of pairs; leave the calibration out"
            )
        sides = self.tx, self.rx
        for name, side, leg in zip(("tx", "rx"), sides, array.legs, strict=True):
            if np.shape(side.nominal_m) != leg.position_m.shape or (
                np.abs(np.array(side.nominal_m) - leg.position_m).max() > SAME_M
            ):
                raise HandbenchError(
                    f"{where}: is for another array, with {len(side.nominal_m)} {name} antennas at "
                    f"other places than the {len(leg.position_m)} of the capture; calibrate the "
                    "array of this capture"
                )
        a, b = (side.response(capture.frequencies_hz, self.reference_hz) for side in sides)
        tx, rx = (np.flatnonzero(side.gains) for side in sides)
        live = (..., tx[:, None], rx)
        measured = None if array.measured is None else array.measured[live]
        return replace(
            capture,
            samples=(capture.samples[live] / (a[:, tx, None] * b[:, None, rx])).astype(
                np.complex64
            ),
            aperture=AntennaArray(array.tx_m[tx], array.rx_m[rx], measured),
            calibration=None,
        )

    def summary(self) -> str:
        """Describe the calibration in one line: number of antennas and of dead ones, source, and
        spread of the gains."""
        gains = np.concatenate([self.tx.gains, self.rx.gains])
        live = np.log(gains[gains != 0])
        return (
            f"{len(gains)} antennas, {len(gains) - len(live)} dead, "
            f"from {self.source}; gains differ by {20 / np.log(10) * live.real.std():.2f} dB and "
            f"{np.degrees(live.imag.std()):.1f}° (RMS)"
        )


def load_array(path: str | Path) -> ArrayCalibration:
    """Read an array calibration from the file `array.json`. Raises HandbenchError for unknown keys,
    wrong shapes, NaN and implausible values."""
    return parse(ArrayCalibration, read_json(path, "an array calibration (array.json)"), str(path))


def with_calibration(capture: RadarCapture, file: Path) -> tuple[RadarCapture, str]:
    """Apply to a capture the calibration in `file` (an `array.json`) or, if there is no such file,
    the one stored in the capture: (calibrated capture, message about what was applied).

    Without either, the result is the unchanged capture and "". Raises HandbenchError if the
    calibration does not fit the capture.
    """
    if file.exists():
        calibration, where = load_array(file), str(file)
    elif capture.calibration is not None:
        where = f"{file.parent}: the {file.name} inside its echoes"
        calibration = parse(ArrayCalibration, capture.calibration, where)
    else:
        return capture, ""
    return calibration.applied_to(capture, where), f"{where}: applied: {calibration.summary()}"
