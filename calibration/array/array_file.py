"""Calibration of an array's antennas, as stored in the file `array.json`, and its application to
captures."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.support.config import Config, Tone, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json

SAME_M = 1e-7  # positions that agree to this are the same; offsets are larger
Gain = Annotated[float, Field(ge=-100, le=100)]
Metres = Annotated[float, Field(ge=-10, le=10)]
Offset = Annotated[float, Field(ge=-5e-3, le=5e-3)]
Delay = Annotated[float, Field(ge=-0.1, le=0.1)]
Sigma = Annotated[float, Field(ge=0, le=100)]


class Side(Config):
    """Calibration of all transmitters, or of all receivers; every list has one entry per antenna.

    nominal_m: positions in captures; offset_m: vector from the nominal to the true position; gain:
    [re, im] at the reference frequency, 0 for a dead antenna; delay_m: delay of the cable, as a
    path. Standard deviations: level_sigma: relative one of |gain|; phase_sigma_rad: of the phase at
    the target's middle, from errors of gain and position together; delay_sigma_m, offset_sigma_m:
    of delay and offset.
    """

    nominal_m: tuple[tuple[Metres, Metres, Metres], ...] = Field(min_length=1)
    gain: tuple[tuple[Gain, Gain], ...]
    delay_m: tuple[Delay, ...]
    offset_m: tuple[tuple[Offset, Offset, Offset], ...]
    level_sigma: tuple[Sigma, ...]
    phase_sigma_rad: tuple[Sigma, ...]
    delay_sigma_m: tuple[Sigma, ...]
    offset_sigma_m: tuple[tuple[Sigma, Sigma, Sigma], ...]

    @model_validator(mode="after")
    def _one_of_each(self) -> "Side":
        for name in type(self).model_fields:
            if len(getattr(self, name)) != len(self.nominal_m):
                raise ValueError(
                    f"'{name}' has {len(getattr(self, name))} entries, but 'nominal_m' has "
                    f"{len(self.nominal_m)} antennas; give one entry for each antenna"
                )
        if not any(part for gain in self.gain for part in gain):
            raise ValueError(
                "every gain is 0, but at least one antenna must work; calibrate the array again"
            )
        return self

    @property
    def gains(self) -> np.ndarray:
        """Complex gains [n] at the reference frequency."""
        return np.array(self.gain) @ [1, 1j]

    @property
    def positions_m(self) -> np.ndarray:
        """True positions [n, 3] of the antennas, metres."""
        return np.array(self.nominal_m) + self.offset_m

    def response(self, frequencies_hz: np.ndarray, reference_hz: float) -> np.ndarray:
        """Compute the complex gains [f, n] of the antennas at each frequency [f], Hz. They include
        the delays, which do not change the phase at the reference frequency."""
        turns_per_m = (np.asarray(frequencies_hz) - reference_hz) / SPEED_OF_LIGHT_M_S
        return self.gains * np.exp(-2j * np.pi * np.multiply.outer(turns_per_m, self.delay_m))


class ArrayCalibration(Config):
    """The content of `array.json`: the calibration of an array's transmitters and receivers.

    source: name of the capture from which it was estimated; residual_before_db, residual_after_db:
    share of the target's echo energy, noise deducted, that the model does not explain with the
    nominal and with the calibrated array.
    """

    format: Literal["handbench-array"] = "handbench-array"
    version: Literal[1] = 1
    source: str
    reference_hz: Tone
    tx: Side
    rx: Side
    residual_before_db: float
    residual_after_db: float

    @property
    def array(self) -> AntennaArray:
        """The array with the true positions of its antennas."""
        return AntennaArray(self.tx.positions_m, self.rx.positions_m)

    def applied_to(
        self, capture: RadarCapture, where: object = "array calibration"
    ) -> RadarCapture:
        """Return the capture with the calibration applied: its samples are divided by the gains of
        their transmitter and receiver, or set to 0 for dead antennas, and its antennas have their
        true positions.

        where: the calibration's file, named in messages. Raises HandbenchError if the capture's
        antennas are not at the nominal positions, because it was recorded by another array or is
        calibrated already.
        """
        if not isinstance(capture.aperture, AntennaArray):
            raise HandbenchError(
                f"{where}: is for an antenna array (MIMO), but the capture is a planar scan or a "
                "list of pairs; leave the calibration out"
            )
        nominal = AntennaArray(np.array(self.tx.nominal_m), np.array(self.rx.nominal_m))
        if _same(capture.aperture, self.array) and not _same(self.array, nominal):
            raise HandbenchError(f"{where}: is already applied to this capture; apply it only once")
        if not _same(capture.aperture, nominal):
            raise HandbenchError(
                f"{where}: is for an array of {nominal.channels} antennas (transmitters, "
                "receivers) whose positions differ from the capture's array of "
                f"{capture.aperture.channels}; calibrate the array of this capture"
            )
        f_hz = capture.frequencies_hz
        responses = (side.response(f_hz, self.reference_hz) for side in (self.tx, self.rx))
        tx, rx = (np.divide(1, r, out=np.zeros_like(r), where=r != 0) for r in responses)
        samples = (capture.samples * tx[:, :, None] * rx[:, None]).astype(np.complex64)
        alive = tx.any(axis=0)[:, None] & rx.any(axis=0)
        measured = alive if capture.aperture.measured is None else alive & capture.aperture.measured
        true = replace(self.array, measured=None if measured.all() else measured)
        return replace(capture, samples=samples, aperture=true, calibration=None)

    def summary(self) -> str:
        """Describe the calibration in one line: number of antennas and of dead ones, source, and
        unexplained share of the echoes before and after."""
        dead = sum(int((side.gains == 0).sum()) for side in (self.tx, self.rx))
        return (
            f"{len(self.tx.gain)} + {len(self.rx.gain)} antennas, {dead} dead, from "
            f"{self.source}; unexplained "
            f"{self.residual_before_db:.1f} → {self.residual_after_db:.1f} dB"
        )


def save_array(path: str | Path, calibration: ArrayCalibration) -> None:
    """Write an array calibration to the file `array.json`, atomically."""
    write_json(path, calibration.model_dump())


def load_array(path: str | Path) -> ArrayCalibration:
    """Read an array calibration from the file `array.json`. Raises HandbenchError for unknown keys,
    wrong shapes, NaN and implausible values."""
    return _array(read_json(path, "an array calibration (array.json)"), str(path))


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
        calibration = _array(capture.calibration, where)
    else:
        return capture, ""
    return calibration.applied_to(capture, where), f"{where}: applied: {calibration.summary()}"


def _array(content: Any, where: str) -> ArrayCalibration:
    if not isinstance(content, dict):
        raise HandbenchError(
            f"{where}: is a {type(content).__name__}; expected a table, the array calibration "
            "(array.json)"
        )
    return parse(ArrayCalibration, content, where)


def _same(one: AntennaArray, other: AntennaArray) -> bool:
    return one.channels == other.channels and all(
        np.abs(a.position_m - b.position_m).max() < SAME_M
        for a, b in zip(one.legs, other.legs, strict=True)
    )
