"""The scene of a simulation: bodies with their materials in front of an array, and the causes of
effects that a scene file can set, such as noise or motion, which cause nothing with their defaults;
and the row of an effect in the table of a simulation."""

import zlib
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.support.config import Config, Near
from handbench.support.rays import Rays

CENTRE_M = np.zeros(3)  # of the aperture, in the radar frame


class Material(Config):
    """The material of a body.

    kind: metal, a perfect mirror; skin, layered, with palm_thickness_m of horny layer on the palm,
    and moist if `wet`; plastic, a dielectric with `permittivity` and `loss_tangent`.
    """

    kind: Literal["metal", "skin", "plastic"] = "metal"
    permittivity: float = Field(default=2.7, ge=1, le=20)  # printed PLA, solid
    loss_tangent: float = Field(default=0.0, ge=0, le=10)
    palm_thickness_m: float = Field(default=140e-6, ge=0, le=2e-3)
    wet: bool = False


METAL = Material()


@dataclass(frozen=True, eq=False)
class Body:
    """A body as a closed triangle mesh in the radar frame.

    vertices_m [n, 3], faces [m, 3]: the mesh, with faces counter-clockwise as seen from outside.
    palm: mask [m] of the faces with the palm's thick horny layer (None: no face). reflectivity_db:
    echo amplitude of a body of the room relative to metal in dB.
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    material: Material = field(default_factory=Material)
    palm: np.ndarray | None = None
    reflectivity_db: float = 0.0


@dataclass(frozen=True)
class Ball:
    """A steel ball; if foam_radius_m is not 0, it is at the centre of a sphere of foam with this
    radius."""

    centre_m: np.ndarray
    radius_m: float
    foam_radius_m: float = 0.0
    foam_permittivity: float = 1.0

    @property
    def foam_delay_m(self) -> float:
        """The extra one-way path of the ball's echo through its foam, metres: (n − 1)·(R_foam −
        r_ball), where n is the foam's refractive index.

        The foam is centred on the ball, so that a ray to the ball's specular point runs along a
        radius and is not refracted.
        """
        foam_m = max(self.foam_radius_m - self.radius_m, 0.0)
        return (float(np.sqrt(self.foam_permittivity)) - 1) * foam_m


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


@dataclass(frozen=True, eq=False)
class EchoScene:
    """A scene as the radar measures it. frequencies_hz [f]: the radar's tones, in any order, some
    perhaps repeatedly; time_s [f]: when each tone is measured, from the start of a frame.
    frame_period_s: time from one frame's start to the next (None: the target starts at the same
    place in every frame).

    target: the measured body (None for a scene with balls only); room: the bodies around it, which
    stay when the target is removed; sensor, noise, motion, roughness: the causes of effects; seed:
    seed of all random draws. origin_m [3]: the target's origin, to which motion.pivot_m is
    relative; bent: the target's vertices [n, 3] as a function of time in seconds, with the motion
    of a hand's fingers alone (None: the target moves as a whole or not at all).
    polarisation_deg: direction of the antennas' electric field, from x towards y (used for echoes
    over two or more places).

    Accuracy: `coarser` multiplies the longest edge of the facets into which surfaces are divided.
    """

    array: AntennaArray
    frequencies_hz: np.ndarray
    time_s: np.ndarray
    target: Body | None = None
    balls: tuple[Ball, ...] = ()
    room: tuple[Body, ...] = ()
    sensor: SensorFaults = field(default_factory=SensorFaults)
    noise: Noise = field(default_factory=Noise)
    motion: Motion = field(default_factory=Motion)
    roughness: Roughness = field(default_factory=Roughness)
    seed: int = 0
    polarisation_deg: float = 90.0
    coarser: float = 1.0
    frame_period_s: float | None = None
    origin_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    bent: Callable[[float], np.ndarray] | None = None
    _cache: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False)

    @property
    def body(self) -> Body:
        """The target body. Raises ValueError for a scene without one."""
        if self.target is None:
            raise ValueError(
                "target: the scene has only balls, but this effect needs a target; add a [target]"
            )
        return self.target

    @property
    def dipole(self) -> np.ndarray:
        """The direction [3] of the antennas' electric field, a unit vector."""
        angle = np.radians(self.polarisation_deg)
        return np.array([np.cos(angle), np.sin(angle), 0.0])

    @property
    def wavelength_m(self) -> float:
        """The length, metres, that sets how finely surfaces are divided: the shortest wavelength
        times `coarser`."""
        return self.coarser * SPEED_OF_LIGHT_M_S / float(self.frequencies_hz.max())

    @property
    def points_m(self) -> np.ndarray:
        """The vertices of the target and the centres of the balls [n, 3], metres."""
        surface = [] if self.target is None else [self.target.vertices_m]
        return np.concatenate([*surface, *(ball.centre_m[None] for ball in self.balls)])

    def seeds(self, effect: str, *keys: int) -> tuple[int, ...]:
        """Return the seed of an effect's random numbers. It depends only on the scene's seed, the
        effect's name and further `keys`, so that the numbers do not change when other effects are
        switched on or off."""
        return (self.seed, zlib.crc32(effect.encode()), *keys)

    def rays_of(self, body: Body) -> Rays:
        """Return the ray caster of a body's mesh, built once per scene."""
        return self.cached(("rays", id(body)), lambda: Rays(body.vertices_m, body.faces))

    def cached(self, key: Hashable, make: Any) -> Any:
        """Return the value stored in this scene under `key`. The first time, it is computed by
        make() and stored, so that all effects of the scene share it."""
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]


def generator(seed: tuple[int, ...]) -> np.random.Generator:
    """Return the random number generator for a seed from `EchoScene.seeds`."""
    return np.random.default_rng(np.random.SeedSequence(seed))


class Choice(Config):
    """The row of one effect in the table of a simulation: whether it is on, and why.

    depth_mm, level_db: what leaving the effect out changes (`--explain`; None: not measured).
    seconds: the time it took (None: the effect is off, or nothing was simulated).
    """

    effect: str
    on: bool
    why: str
    depth_mm: float | None = None
    level_db: float | None = None
    seconds: float | None = None
