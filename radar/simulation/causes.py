"""The causes that a scene names for its effects; the defaults cause nothing."""

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from handbench.support.config import Config


class Noise(Config):
    """Thermal noise of the receivers, by one of two keys. phase_noise_rad: standard deviation of
    the phase *between two tones* at the strongest pixel; snr_db: power of the strongest pixel over
    that of the noise in the image of one tone. Neither given: no noise."""

    phase_noise_rad: float = Field(default=0.0, ge=0)
    snr_db: float | None = Field(default=None, ge=-200, le=200)

    @model_validator(mode="after")
    def _one_of_both(self) -> "Noise":
        if self.phase_noise_rad and self.snr_db is not None:
            raise ValueError("phase_noise_rad and snr_db are both given; give only one of them")
        return self

    @property
    def between_tones_rad(self) -> float:
        """Standard deviation of the phase between two tones at the strongest pixel: 1/√SNR, since
        half of the noise power affects the phase of each tone."""
        return self.phase_noise_rad if self.snr_db is None else 10 ** (-self.snr_db / 20)


class Oscillator(Config):
    """Phase noise of the common oscillator. level_dbc_hz: noise power per Hz relative to the
    carrier's, 1 MHz from it (None: no noise); it falls with 1/f². bandwidth_hz: of the receiver's
    filter. Transmitter and receiver share the oscillator, so that the target's short delay cancels
    most of it."""

    level_dbc_hz: float | None = Field(default=None, ge=-300, lt=0)
    bandwidth_hz: float = Field(default=1e6, gt=0)

    @property
    def density(self) -> float:
        """Power density of the noise over the carrier's power in 1/Hz, at 1 MHz from the carrier; 0
        without a level."""
        return 0.0 if self.level_dbc_hz is None else 10 ** (self.level_dbc_hz / 10)


Direction = tuple[float, float, float]


def require_direction(direction: Direction) -> Direction:
    """Return the direction. Raises ValueError if its length is (almost) zero or extremely large."""
    if not 1e-6 < sum(part**2 for part in direction) < 1e6:
        raise ValueError(
            "expected a direction of three numbers such as [0, 0, 1], neither zero nor huge"
        )
    return direction


class Motion(Config):
    """Rigid motion of the target along `direction` (radar frame): tremor, a sine with the peak
    amplitude_m, frequency_hz and a random phase, plus a constant velocity_m_s. The displacement
    counts from the target's place at the start of each frame."""

    amplitude_m: float = Field(default=0.0, ge=0, le=0.01)
    frequency_hz: float = Field(default=9.0, gt=0)
    velocity_m_s: float = Field(default=0.0, ge=-100, le=100)
    direction: Annotated[Direction, AfterValidator(require_direction)] = (0.0, 0.0, 1.0)


class Roughness(Config):
    """Relief of the target that its mesh does not show: random heights with standard deviation
    rms_m, whose correlation falls with distance r as exp(−r²/correlation_m²); and the layer lines
    of a print, layer_depth_m from ridge to valley and layer_pitch_m apart along the direction
    layers_along (radar frame)."""

    rms_m: float = Field(default=0.0, ge=0, le=1e-3)
    correlation_m: float = Field(default=1e-3, ge=1e-5, le=1)
    layer_depth_m: float = Field(default=0.0, ge=0, le=1e-3)
    layer_pitch_m: float = Field(default=2e-4, ge=1e-5, le=1)
    layers_along: Annotated[Direction, AfterValidator(require_direction)] = (0.0, 1.0, 0.0)

    @property
    def sigma_m(self) -> float:
        """Standard deviation of all heights in metres, layer lines (a sine) included."""
        return float(np.hypot(self.rms_m, self.layer_depth_m / np.sqrt(8)))


class Pattern(Config):
    """Antenna pattern of each antenna, a power of cos θ. beamwidth_deg: its full width at half
    power (None: the same in all directions)."""

    beamwidth_deg: float | None = Field(default=None, gt=1, lt=180)

    @property
    def exponent(self) -> float:
        """The exponent q of the amplitude pattern cosᵠθ: its power, cos²ᵠθ, is half at half the
        beamwidth off the axis. 0 without a beamwidth: the same in all directions."""
        if self.beamwidth_deg is None:
            return 0.0
        return float(-np.log(2) / (2 * np.log(np.cos(np.radians(self.beamwidth_deg) / 2))))


class Coupling(Config):
    """Leakage from transmitters to receivers. level_db: its power, averaged over all channels,
    relative to that of the target's samples (None: no leakage)."""

    level_db: float | None = Field(default=None, ge=-200, le=200)

    @property
    def amplitude(self) -> float:
        """The leakage's amplitude relative to that of the target's samples; 0 without a level."""
        return 0.0 if self.level_db is None else 10 ** (self.level_db / 20)


class Positions(Config):
    """Errors of the antennas' positions. sigma_m: standard deviation, along each of x, y and z, of
    an antenna's true position from the nominal one that the capture states."""

    sigma_m: float = Field(default=0.0, ge=0, le=0.01)


class Channels(Config):
    """Errors of each antenna's channel, as standard deviations: gain_db; phase_rad, the same at all
    tones; delay_m, a delay as a length in metres."""

    gain_db: float = Field(default=0.0, ge=0, le=100)
    phase_rad: float = Field(default=0.0, ge=0, le=100)
    delay_m: float = Field(default=0.0, ge=0, le=10)


class Dead(Config):
    """Antennas whose samples are zero. tx, rx: numbers of the transmitters and of the receivers,
    from 0."""

    tx: tuple[int, ...] = ()
    rx: tuple[int, ...] = ()


class Converter(Config):
    """Analogue-to-digital conversion. bits: of each quadrature (None: exact); headroom_db: by how
    much full scale is above the largest sample (negative: the largest samples are clipped)."""

    bits: int | None = Field(default=None, ge=1, le=32)
    headroom_db: float = Field(default=6.0, ge=-100, le=200)


class SensorFaults(Config):
    """Imperfections of a sensor: what causes the effects of this name in simulated echoes. The
    defaults are ideal."""

    oscillator: Oscillator = Oscillator()
    pattern: Pattern = Pattern()
    coupling: Coupling = Coupling()
    positions: Positions = Positions()
    channels: Channels = Channels()
    dead: Dead = Dead()
    converter: Converter = Converter()


class Causes(SensorFaults):
    """What causes effects in a scene's echoes: imperfections of the sensor, noise, and the target's
    motion and roughness."""

    noise: Noise = Noise()
    motion: Motion = Motion()
    roughness: Roughness = Roughness()
