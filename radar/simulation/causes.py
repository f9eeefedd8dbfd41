"""The causes that a scene names for its effects; the defaults cause nothing."""

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from handbench.support.config import Config


class Noise(Config):
    """Thermal noise: phase_noise_rad, standard deviation of the phase *between two tones* at the
    strongest pixel; or snr_db, the strongest pixel's power against the noise in the image of one
    tone. Nothing: no noise."""

    phase_noise_rad: float = Field(default=0.0, ge=0)
    snr_db: float | None = Field(default=None, ge=-200, le=200)

    @model_validator(mode="after")
    def _one_of_both(self) -> "Noise":
        if self.phase_noise_rad and self.snr_db is not None:
            raise ValueError("give either phase_noise_rad or snr_db")
        return self

    @property
    def between_tones_rad(self) -> float:
        """Standard deviation of the phase between two tones at the strongest pixel: 1/√SNR, since
        half of the noise power affects the phase of each tone."""
        return self.phase_noise_rad if self.snr_db is None else 10 ** (-self.snr_db / 20)


class Oscillator(Config):
    """Phase noise of the common oscillator: level_dbc_hz at 1 MHz from the carrier, falling with
    1/f²; bandwidth_hz of the receiver's filter. Transmitter and receiver share it, so that the
    target's short delay cancels most of it."""

    level_dbc_hz: float | None = Field(default=None, ge=-300, lt=0)
    bandwidth_hz: float = Field(default=1e6, gt=0)

    @property
    def density(self) -> float:
        """Noise density over the carrier's power, 1/Hz, at 1 MHz from the carrier; 0 without a
        level."""
        return 0.0 if self.level_dbc_hz is None else 10 ** (self.level_dbc_hz / 10)


Direction = tuple[float, float, float]


def require_direction(direction: Direction) -> Direction:
    """Raise ValueError for a direction without a length."""
    if not 1e-6 < sum(part**2 for part in direction) < 1e6:
        raise ValueError("expected a direction as [0, 0, 1]")
    return direction


class Motion(Config):
    """Rigid motion of the target along `direction` (radar frame): a sine of tremor (peak
    amplitude_m, frequency_hz, random phase) plus a constant velocity_m_s. At the first tone of each
    frame the displacement is zero."""

    amplitude_m: float = Field(default=0.0, ge=0, le=0.01)
    frequency_hz: float = Field(default=9.0, gt=0)
    velocity_m_s: float = Field(default=0.0, ge=-100, le=100)
    direction: Annotated[Direction, AfterValidator(require_direction)] = (0.0, 0.0, 1.0)


class Roughness(Config):
    """Relief of the target that its mesh does not have: heights of standard deviation rms_m, whose
    correlation falls as exp(−r²/correlation_m²); and a print's layer lines, layer_depth_m from
    ridge to valley and layer_pitch_m apart along `layers_along` (radar frame)."""

    rms_m: float = Field(default=0.0, ge=0, le=1e-3)
    correlation_m: float = Field(default=1e-3, ge=1e-5, le=1)
    layer_depth_m: float = Field(default=0.0, ge=0, le=1e-3)
    layer_pitch_m: float = Field(default=2e-4, ge=1e-5, le=1)
    layers_along: Annotated[Direction, AfterValidator(require_direction)] = (0.0, 1.0, 0.0)

    @property
    def sigma_m(self) -> float:
        """Standard deviation of all heights; the lines' profile is a sine."""
        return float(np.hypot(self.rms_m, self.layer_depth_m / np.sqrt(8)))


class Pattern(Config):
    """Antenna pattern: beamwidth_deg, the full width at half power of one antenna, as a power of
    cos θ."""

    beamwidth_deg: float | None = Field(default=None, gt=1, lt=180)

    @property
    def exponent(self) -> float:
        """q of the amplitude cosᵠθ whose power, cos²ᵠθ, is halved at half the beamwidth off the
        axis; 0: even."""
        if self.beamwidth_deg is None:
            return 0.0
        return float(-np.log(2) / (2 * np.log(np.cos(np.radians(self.beamwidth_deg) / 2))))


class Coupling(Config):
    """Leakage from transmitters to receivers: level_db, its mean power over the channels against
    the target's."""

    level_db: float | None = Field(default=None, ge=-200, le=200)

    @property
    def amplitude(self) -> float:
        """The level as an amplitude; 0 without a level."""
        return 0.0 if self.level_db is None else 10 ** (self.level_db / 20)


class Positions(Config):
    """Standard deviation of each antenna's true position about the one in the capture, per axis."""

    sigma_m: float = Field(default=0.0, ge=0, le=0.01)


class Channels(Config):
    """Standard deviations of each antenna's gain (dB), phase (rad, the same at all tones) and delay
    (as a length)."""

    gain_db: float = Field(default=0.0, ge=0, le=100)
    phase_rad: float = Field(default=0.0, ge=0, le=100)
    delay_m: float = Field(default=0.0, ge=0, le=10)


class Dead(Config):
    """Numbers of the antennas whose samples are zero."""

    tx: tuple[int, ...] = ()
    rx: tuple[int, ...] = ()


class Converter(Config):
    """Analogue-to-digital conversion: bits of each quadrature; headroom_db between the largest
    sample and full scale (negative: the largest are clipped)."""

    bits: int | None = Field(default=None, ge=1, le=32)
    headroom_db: float = Field(default=6.0, ge=-100, le=200)


class SensorFaults(Config):
    """Imperfections of a sensor."""

    oscillator: Oscillator = Oscillator()
    pattern: Pattern = Pattern()
    coupling: Coupling = Coupling()
    positions: Positions = Positions()
    channels: Channels = Channels()
    dead: Dead = Dead()
    converter: Converter = Converter()


class Causes(SensorFaults):
    """All causes of a scene."""

    noise: Noise = Noise()
    motion: Motion = Motion()
    roughness: Roughness = Roughness()
