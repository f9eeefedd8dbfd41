"""The causes of effects that a scene file can set, such as noise or motion; with their defaults
they cause nothing."""

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from handbench.support.config import Config, Near


class Noise(Config):
    """Thermal noise of the receivers, given by one of two keys; without either there is no noise.

    phase_noise_rad: standard deviation of the phase *between two tones* at the strongest pixel;
    snr_db: power of the strongest pixel over that of the noise in the image of one tone.
    """

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
    """Phase noise of the oscillator that transmitters and receivers share. The target's delay is
    short, so that most of it cancels.

    level_dbc_hz: noise power per Hz relative to the carrier's, 1 MHz from it (None: no noise); it
    falls with 1/f². bandwidth_hz: bandwidth of the receiver's filter.
    """

    level_dbc_hz: float | None = Field(default=None, ge=-300, lt=0)
    bandwidth_hz: float = Field(default=1e6, gt=0)

    @property
    def density(self) -> float:
        """Power density of the noise 1 MHz from the carrier, over the carrier's power, in 1/Hz; 0
        if no level is given."""
        return 0.0 if self.level_dbc_hz is None else 10 ** (self.level_dbc_hz / 10)


Direction = tuple[float, float, float]


def require_direction(direction: Direction) -> Direction:
    """Return the direction. Raises ValueError if its length is (almost) zero or extremely large."""
    if not 1e-6 < sum(part**2 for part in direction) < 1e6:
        raise ValueError(
            "expected a direction of three numbers such as [0, 0, 1], neither zero nor huge"
        )
    return direction


DegreesPerSecond = Annotated[float, Field(ge=-3600, le=3600)]


class Motion(Config):
    """Rigid motion of the target, in the radar frame: a rotation, then a displacement.

    The displacement along `direction` is the sum of a tremor, a sine with the peak amplitude_m,
    frequency_hz and a random phase, and of a constant velocity_m_s. rotation_deg_s: constant
    angular velocity as a rotation vector; pivot_m: point about which the target turns, relative to
    the target's origin.
    """

    amplitude_m: float = Field(default=0.0, ge=0, le=0.01)
    frequency_hz: float = Field(default=9.0, gt=0)
    velocity_m_s: float = Field(default=0.0, ge=-100, le=100)
    direction: Annotated[Direction, AfterValidator(require_direction)] = (0.0, 0.0, 1.0)
    rotation_deg_s: tuple[DegreesPerSecond, DegreesPerSecond, DegreesPerSecond] = (0.0, 0.0, 0.0)
    pivot_m: tuple[Near, Near, Near] = (0.0, 0.0, 0.0)

    @property
    def along(self) -> np.ndarray:
        """The unit vector [3] along `direction`."""
        return np.array(self.direction) / np.linalg.norm(self.direction)


class Roughness(Config):
    """Relief of the target that its mesh is too coarse to have: random heights, and the layer lines
    of a 3D print.

    The random heights have the standard deviation rms_m, and their correlation falls with distance
    r as exp(−r²/correlation_m²). The layer lines are layer_depth_m from ridge to valley and
    layer_pitch_m apart along the direction layers_along (radar frame).
    """

    rms_m: float = Field(default=0.0, ge=0, le=1e-3)
    correlation_m: float = Field(default=1e-3, ge=1e-5, le=1)
    layer_depth_m: float = Field(default=0.0, ge=0, le=1e-3)
    layer_pitch_m: float = Field(default=2e-4, ge=1e-5, le=1)
    layers_along: Annotated[Direction, AfterValidator(require_direction)] = (0.0, 1.0, 0.0)

    @property
    def sigma_m(self) -> float:
        """Standard deviation of all heights in metres, including the layer lines, whose profile is
        a sine."""
        return float(np.hypot(self.rms_m, self.layer_depth_m / np.sqrt(8)))


class Pattern(Config):
    """Radiation pattern of each antenna, a power of cos θ. beamwidth_deg: its full width at half
    power (None: isotropic)."""

    beamwidth_deg: float | None = Field(default=None, gt=1, lt=180)

    @property
    def exponent(self) -> float:
        """The exponent q of the amplitude pattern cosᵠθ, for which the power cos²ᵠθ is one half at
        half the beamwidth from the axis; 0, an isotropic antenna, if no beamwidth is given."""
        if self.beamwidth_deg is None:
            return 0.0
        return float(-np.log(2) / (2 * np.log(np.cos(np.radians(self.beamwidth_deg) / 2))))


class Coupling(Config):
    """Leakage from transmitters to receivers. level_db: its power, averaged over all channels,
    relative to that of the target's samples (None: no leakage)."""

    level_db: float | None = Field(default=None, ge=-200, le=200)

    @property
    def amplitude(self) -> float:
        """The leakage's amplitude relative to that of the target's samples; 0 if no level is
        given."""
        return 0.0 if self.level_db is None else 10 ** (self.level_db / 20)


class Positions(Config):
    """Errors of the antennas' positions. sigma_m: standard deviation, along each of x, y and z, of
    an antenna's true position from the nominal position in the capture."""

    sigma_m: float = Field(default=0.0, ge=0, le=0.01)


class Channels(Config):
    """Errors of each antenna's gain, phase and delay, as standard deviations over the antennas.
    gain_db; phase_rad: a phase that is the same at all tones; delay_m: a delay, as a length in
    metres."""

    gain_db: float = Field(default=0.0, ge=0, le=100)
    phase_rad: float = Field(default=0.0, ge=0, le=100)
    delay_m: float = Field(default=0.0, ge=0, le=10)


class Dead(Config):
    """Antennas without signal, whose samples are zero. tx, rx: numbers of the transmitters and of
    the receivers, from 0."""

    tx: tuple[int, ...] = ()
    rx: tuple[int, ...] = ()


class Converter(Config):
    """Analogue-to-digital conversion. bits: number of bits of each quadrature (None: exact);
    headroom_db: by how much full scale exceeds the largest sample (negative: the largest samples
    are clipped)."""

    bits: int | None = Field(default=None, ge=1, le=32)
    headroom_db: float = Field(default=6.0, ge=-100, le=200)


class SensorFaults(Config):
    """Imperfections of a sensor, each of which causes the effect of the same name in simulated
    echoes; by default there are none."""

    oscillator: Oscillator = Oscillator()
    pattern: Pattern = Pattern()
    coupling: Coupling = Coupling()
    positions: Positions = Positions()
    channels: Channels = Channels()
    dead: Dead = Dead()
    converter: Converter = Converter()
