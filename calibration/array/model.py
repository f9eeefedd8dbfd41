"""Model of the calibration target's echoes at an imperfect array, and its derivatives with respect
to the unknowns:

    s[f, t, r] = a_t · b_r · Σ_i c_i · e_i[f, t, r]
    e_i ~ exp(−jk(|t − q_i| + |q_i − r| − 2R·cos β + 2δ))

with the antennas' gains a, b (level, phase, delay), their true positions t, r, and the balls'
centres q_i, radius R, half bistatic angle β and foam delay δ. The balls' complex strengths c_i are
unknown too, since the foam's refractive index is not known precisely enough for phases.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from handbench.calibration.spheres.description import Target
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.simulation.physics.spheres import sphere_echo

# an antenna's unknowns: log level, phase, delay, offset
LEVEL, PHASE, DELAY, PLACE, EACH = (0, 1, 2, slice(3, 6), 6)
BALL = 5  # a ball's unknowns: centre (all balls'), then log level (all), then phase (all)


@dataclass(frozen=True)
class Antennas:
    """The unknowns of all transmitters, or of all receivers.

    nominal_m [n, 3]: positions in captures; offset_m [n, 3]: vectors from these to the true
    positions; log_gain, complex [n]: logarithm of the gain, log level + j · phase; delay_m [n]:
    delay of the cable, as a path in metres.
    """

    nominal_m: np.ndarray
    log_gain: np.ndarray
    delay_m: np.ndarray
    offset_m: np.ndarray

    @property
    def position_m(self) -> np.ndarray:
        """True positions [n, 3] of the antennas, metres."""
        return self.nominal_m + self.offset_m

    @property
    def unknowns(self) -> np.ndarray:
        """The unknowns of each antenna as a row [n, 6]: log level, phase, delay and offset (3)."""
        return np.column_stack(
            [self.log_gain.real, self.log_gain.imag, self.delay_m, self.offset_m]
        )

    def moved(self, step: np.ndarray) -> "Antennas":
        """Return the antennas with a step [n, 6] added to their unknowns."""
        log_gain = self.log_gain + step[:, LEVEL] + 1j * step[:, PHASE]
        return Antennas(
            self.nominal_m, log_gain, self.delay_m + step[:, DELAY], self.offset_m + step[:, PLACE]
        )


@dataclass(frozen=True)
class State:
    """Values of all unknowns of the array's calibration: those of transmitters and receivers, the
    balls' centres_m [i, 3], and log_ball [i], the complex logarithm of the balls' echo strengths.
    Vectors [u] of all unknowns have them in this order."""

    tx: Antennas
    rx: Antennas
    centres_m: np.ndarray
    log_ball: np.ndarray

    @property
    def array(self) -> AntennaArray:
        """The array with the antennas at their estimated positions."""
        return AntennaArray(self.tx.position_m, self.rx.position_m)

    @property
    def counts(self) -> tuple[int, int, int]:
        """Number of transmitters, receivers and balls."""
        return len(self.tx.delay_m), len(self.rx.delay_m), len(self.log_ball)

    def moved(self, step: np.ndarray) -> "State":
        """Return the state with a step [u] added to all unknowns."""
        tx, rx, centres, (level, phase) = split(step, *self.counts)
        return State(
            self.tx.moved(tx),
            self.rx.moved(rx),
            self.centres_m + centres,
            self.log_ball + level + 1j * phase,
        )


def split(values: np.ndarray, n_tx: int, n_rx: int, n_balls: int) -> tuple[np.ndarray, ...]:
    """Split a vector of all unknowns [u] into views of its parts: transmitters [t, 6], receivers
    [r, 6], balls' centres [i, 3], and balls' strengths [2, i] (log level, phase)."""
    ends = np.cumsum([EACH * n_tx, EACH * n_rx, 3 * n_balls])
    shapes = (n_tx, EACH), (n_rx, EACH), (n_balls, 3), (2, n_balls)
    return tuple(
        part.reshape(shape) for part, shape in zip(np.split(values, ends), shapes, strict=True)
    )


@dataclass(frozen=True)
class TargetEchoes:
    """Model of the echoes of a target's balls, at the sweep's frequencies_hz [f]."""

    target: Target
    frequencies_hz: np.ndarray

    @property
    def wavenumber(self) -> np.ndarray:
        """Wavenumbers k [f], rad/m."""
        return 2 * np.pi * self.frequencies_hz / SPEED_OF_LIGHT_M_S

    @property
    def reference_hz(self) -> float:
        """The frequency at which antennas' gains are defined, the middle of the sweep: delays do
        not change the phase there."""
        return float(self.frequencies_hz.mean())

    def balls(self, centres_m: np.ndarray, array: AntennaArray) -> np.ndarray:
        """Simulate the echoes of balls at these centres [i, 3], with strength 1 and with antennas
        of gain 1: complex64 [t, r, i, f]."""
        n_tx, n_rx = array.channels
        echoes = np.empty((n_tx, n_rx, len(centres_m), len(self.frequencies_hz)), np.complex64)
        for i, (element, delay_m) in enumerate(
            zip(self.target.element, self.target.foam_delay_m, strict=True)
        ):
            echo = sphere_echo(
                centres_m[i], element.ball_radius_m, delay_m, self.frequencies_hz, array
            )
            echoes[:, :, i] = np.moveaxis(echo / np.float32(element.ball_radius_m), 0, -1)
        return echoes

    def gain(self, side: Antennas) -> np.ndarray:
        """Compute the gains of the transmitters, or of the receivers, at each frequency, including
        their delays: complex64 [n, f]."""
        about = self.wavenumber - self.wavenumber.mean()
        return np.exp(side.log_gain[:, None] - 1j * np.multiply.outer(side.delay_m, about)).astype(
            np.complex64
        )

    def terms(self, state: State) -> Iterator[np.ndarray]:
        """Yield the modelled samples of one transmitter after another, as a contribution of each
        ball: complex64 [r, i, f]."""
        balls = self.balls(state.centres_m, state.array)
        strength = np.exp(state.log_ball).astype(np.complex64)[:, None]
        to, back = self.gain(state.tx), self.gain(state.rx)[:, None]
        for gain, ball in zip(to, balls, strict=True):
            yield ball * (strength * gain) * back


def normal_equations(
    samples: np.ndarray, state: State, echoes: TargetEchoes
) -> tuple[np.ndarray, np.ndarray, float]:
    """Compute the normal equations of the fit to samples [t, r, f]: (JᵀJ [u, u], Jᵀρ [u], mean
    power of the residual ρ = samples − model).

    J has the derivatives of the samples with respect to all u unknowns. A sample depends only on
    the unknowns of its two antennas and of the balls, so each channel has c = 12 + 5i columns of J.
    """
    n_tx, n_rx, n_balls = state.counts
    size = EACH * (n_tx + n_rx) + BALL * n_balls
    normal, right, power = np.zeros((size, size)), np.zeros(size), 0.0
    # columns of each receiver's unknowns
    antennas = EACH * n_tx + EACH * np.arange(n_rx)[:, None] + np.arange(EACH)
    last = np.arange(EACH * (n_tx + n_rx), size)
    rx, common = slice(EACH, 2 * EACH), slice(2 * EACH, None)
    # Derivatives of each ball's path by the antennas' offsets; that by the ball's own position is
    # minus their sum. The specular point's way round the ball turns them by less than a hundredth,
    # which only costs a little speed.
    to, back = (
        directions(state.centres_m, side).astype(np.complex64) for side in (state.tx, state.rx)
    )
    for t, terms in enumerate(echoes.terms(state)):
        along = np.broadcast_to(to[t], back.shape), back
        columns, rest = _columns(terms, along, echoes.wavenumber), samples[t] - terms.sum(axis=1)
        power += float(np.vdot(rest, rest).real)
        gram = (columns @ columns.swapaxes(1, 2)).astype(np.float64)  # [r, c, c]
        pull = (columns @ rest.view(np.float32)[..., None])[..., 0].astype(np.float64)
        tx = slice(EACH * t, EACH * (t + 1))
        normal[tx, tx] = gram[:, :EACH, :EACH].sum(axis=0)
        normal[tx, antennas.ravel()] = np.hstack(gram[:, :EACH, rx])
        normal[tx, last] = gram[:, :EACH, common].sum(axis=0)
        normal[antennas[:, :, None], antennas[:, None]] += gram[:, rx, rx]
        normal[antennas[:, :, None], last] += gram[:, rx, common]
        normal[last[:, None], last] += gram[:, common, common].sum(axis=0)
        right[tx] = pull[:, :EACH].sum(axis=0)
        right[antennas] += pull[:, rx]
        right[last] += pull[:, common].sum(axis=0)
    return np.triu(normal) + np.triu(normal, 1).T, right, power / samples.size


def directions(points_m: np.ndarray, side: Antennas) -> np.ndarray:
    """Compute the unit vectors [n, i, 3] from points [i, 3] to antennas [n], which are the
    derivatives of the path lengths with respect to the antennas' offsets."""
    away = side.position_m[:, None] - points_m
    return away / np.linalg.norm(away, axis=2, keepdims=True)


def _columns(
    terms: np.ndarray, slopes: tuple[np.ndarray, np.ndarray], wavenumber: np.ndarray
) -> np.ndarray:
    """Compute the derivatives of one transmitter's modelled samples with respect to the c unknowns
    that they depend on: float32 [r, c, 2f], with real and imaginary parts in turn.

    terms [r, i, f]: each ball's contribution; slopes: unit vectors [r, i, 3] from the balls to the
    transmitter and to the receivers. The unknowns are in the order transmitter, receiver, balls'
    centres, log levels, phases.
    """
    model = terms.sum(axis=1, keepdims=True)
    about = (wavenumber - wavenumber.mean()).astype(np.float32)
    gains = [model, 1j * model, -1j * about * model]
    turned = terms * (-1j * wavenumber).astype(np.complex64)
    places = [along.swapaxes(1, 2) @ turned for along in slopes]
    centres = -(slopes[0] + slopes[1])[..., None] * turned[:, :, None]  # [r, i, 3, f]
    centres = centres.reshape(len(terms), -1, terms.shape[-1])
    columns = np.concatenate(
        [*gains, places[0], *gains, places[1], centres, terms, 1j * terms], axis=1
    )
    return columns.astype(np.complex64, copy=False).view(np.float32)
