"""Detection of the target's steel balls in the radar image.

A ball's echo comes from its near surface through the foam: over the channel (t, r) its path is |t −
c| + |c − r| − 2a·cos β + 2δ, with the ball's centre c and radius a, half the bistatic angle β and
the foam's one-way delay δ. Peaks of the image are found one after another, each in the residual of
the others (RELAX, Li & Stoica 1996), so side lobes are not mistaken for balls and do not bias them;
each peak is then converted to the centre of a ball.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from pydantic import Field
from scipy.ndimage import maximum_filter

from handbench.calibration.spheres.description import Candidate, Target
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.data.capture import RadarCapture, scaled_to_one
from handbench.radar.data.grid import Axis, GridConfig, VoxelGrid
from handbench.radar.imaging.api import image_volume
from handbench.radar.imaging.cpu.exact import exact_images, path_lengths
from handbench.radar.imaging.cpu.executor import ToneSkeleton
from handbench.radar.imaging.cpu.steering import phasor
from handbench.radar.simulation.physics.spheres import half_angle_cosine, path_gradients
from handbench.support.errors import HandbenchError

REACH_M = 0.006  # a seed is at most this far from its peak, per axis
# the wide stencil finds the summit, the narrow one is not biased by its skew
STENCIL_STEPS_M = 5e-4, 1e-4
MAX_STEPS = 20
STENCIL = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
_X, _Y, _Z = STENCIL.T
QUADRATIC = np.linalg.pinv(
    np.stack([_X * 0 + 1, _X, _Y, _Z, _X**2, _Y**2, _Z**2, _X * _Y, _X * _Z, _Y * _Z], axis=1)
)


class EchoSearch(GridConfig):
    """Settings of the search for balls. x, y, z: the volume in the radar frame; threshold_db: the
    weakest echo that counts, relative to the strongest; max_peaks: largest number of echoes;
    relaxations: how many times each echo is fitted again to the samples without the other
    echoes."""

    x: Axis = Axis(start_m=-0.15, stop_m=0.15, step_m=0.003)
    y: Axis = Axis(start_m=-0.15, stop_m=0.15, step_m=0.003)
    z: Axis = Axis(start_m=0.2, stop_m=0.45, step_m=0.006)
    # low: the foam's weak faces pull at the balls unless explained
    threshold_db: float = Field(default=-26.0, lt=0)
    max_peaks: int = Field(default=16, ge=1)
    # times that each echo is refined in what the others leave over
    relaxations: int = Field(default=3, ge=0)

    @property
    def threshold(self) -> float:
        """The threshold as a ratio of amplitudes, less than 1."""
        return 10 ** (self.threshold_db / 20)


@dataclass(frozen=True)
class Peak:
    """A point-like echo found in the radar image. position_m [3]: the image's maximum; strength:
    norm of the echo's samples; covariance_m2 [3, 3]: that of the position."""

    position_m: np.ndarray
    strength: float
    covariance_m2: np.ndarray


@dataclass(frozen=True)
class DetectedBall(Candidate):
    """A steel ball detected by the radar. peak_m [3]: the image's maximum, which is in front of the
    ball's centre; level_db: strength of the echo relative to the strongest one."""

    peak_m: np.ndarray
    level_db: float


def find_balls(
    capture: RadarCapture, target: Target, search: EchoSearch | None = None
) -> list[DetectedBall]:
    """Find all echoes in a capture's first frame that may be the target's balls, the strongest
    first.

    An echo is listed once for each size of element, since the centre of the ball behind its peak
    depends on the size. search: volume and threshold (None: the defaults). Raises HandbenchError
    for a capture without a MIMO array, or with tones too sparse for the volume's depth.
    """
    search = search or EchoSearch()
    samples, frequencies_hz, array = capture.samples[0], capture.frequencies_hz, mimo_array(capture)
    depth_m = search.z.stop_m - search.z.start_m
    spacing_hz = np.diff(np.sort(frequencies_hz)).max(initial=0.0) or np.inf
    if SPEED_OF_LIGHT_M_S / (2 * spacing_hz) < depth_m:
        raise HandbenchError(
            f"capture: its {len(frequencies_hz)} tones are ambiguous in range beyond "
            f"{1e3 * SPEED_OF_LIGHT_M_S / (2 * spacing_hz):.0f} mm, but the search needs "
            f"{1e3 * depth_m:.0f} mm; record the target with a smaller step between tones"
        )
    seeds_m = coarse_peaks(samples, frequencies_hz, array, search)
    radius_m = float(np.median([element.ball_radius_m for element in target.element]))
    peaks = separate_echoes(samples, frequencies_hz, array, seeds_m, search, radius_m)
    strongest = max((peak.strength for peak in peaks), default=1.0)
    balls = []
    for peak, ((radius_m, delay_m), elements) in product(peaks, _sizes(target).items()):
        centre_m = ball_centre(peak.position_m, frequencies_hz, array, radius_m, delay_m)
        level_db = float(20 * np.log10(peak.strength / strongest))
        balls.append(
            DetectedBall(centre_m, peak.covariance_m2, elements, peak.position_m, level_db)
        )
    return balls


def mimo_array(capture: RadarCapture) -> AntennaArray:
    """Return the capture's MIMO array. Raises HandbenchError for a planar scan, for missing pairs
    of transmitter and receiver, and for a capture in another medium than air."""
    array = capture.aperture
    if not isinstance(array, AntennaArray):
        raise HandbenchError(
            "capture: is a planar scan, which cannot be calibrated with a target; use echoes of a "
            "MIMO array"
        )
    if array.measured is not None:
        raise HandbenchError(
            "capture: some pairs of a transmitter and a receiver were not measured; record the "
            "calibration target with all pairs"
        )
    if capture.wave_speed_m_s != SPEED_OF_LIGHT_M_S:
        raise HandbenchError(
            f"capture: wave_speed_m_s is {capture.wave_speed_m_s:g} m/s, which is not that of air; "
            "record the calibration target in air"
        )
    return array


def coarse_peaks(
    samples: np.ndarray, frequencies_hz: np.ndarray, array: AntennaArray, search: EchoSearch
) -> np.ndarray:
    """Find the local maxima [n, 3] of the radar image's magnitude above the threshold, metres, on
    the grid of the search. Only every second antenna is used, which is enough for first guesses of
    the echoes' positions."""
    grid = VoxelGrid(search.x.values_m(), search.y.values_m(), search.z.values_m())
    # enough for seeds; `separate_echoes` rejects false ones
    half = AntennaArray(array.tx_m[::2], array.rx_m[::2])
    some = scaled_to_one(samples[:, ::2, ::2])
    magnitude = np.abs(image_volume(some, frequencies_hz, half, grid, tolerance=1e-2))
    loud = magnitude > max(search.threshold * magnitude.max(), 1e-30)
    return grid.points_m()[loud & (magnitude == maximum_filter(magnitude, size=3))]


def separate_echoes(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    seeds_m: np.ndarray,
    search: EchoSearch,
    radius_m: float,
) -> list[Peak]:
    """Decompose samples [f, t, r] into echoes of balls of radius_m: a list of `Peak`, the strongest
    first. Each echo is fitted to the samples without the other echoes.

    seeds_m [n, 3]: rough positions of the echoes; the one with the brightest image in the remaining
    samples is fitted next. Echoes weaker than the threshold of the search are left out.
    """
    rest = samples
    found: list[tuple[np.ndarray, np.ndarray]] = []  # position, echo
    least = least_seen = 0.0
    while len(seeds_m) and len(found) < search.max_peaks:
        seen = np.abs(exact_images(rest, frequencies_hz, array, seeds_m, False)[0])
        loudest = int(seen.argmax())
        if seen[loudest] < least_seen:
            break  # only side lobes of the explained echoes are left
        position_m, echo = fit_echo(rest, frequencies_hz, array, seeds_m[loudest], radius_m)
        seeds_m = np.delete(seeds_m, loudest, axis=0)
        if np.linalg.norm(echo) < least:
            continue
        if not found:
            least = search.threshold * float(np.linalg.norm(echo))
            # the half: a seed lies beside its peak
            least_seen = 0.5 * search.threshold * seen[loudest]
        found.append((position_m, echo))
        rest = rest - echo
    for _ in range(search.relaxations):
        for i, (position_m, echo) in enumerate(found):
            rest = rest + echo
            found[i] = fit_echo(rest, frequencies_hz, array, position_m, radius_m)
            rest = rest - found[i][1]
    noise = float(np.mean(np.abs(rest) ** 2))
    peaks = []
    for position_m, echo in found:
        strength, spread = np.linalg.norm(echo), _phase_spread(position_m, frequencies_hz, array)[0]
        peaks.append(
            Peak(position_m, float(strength), noise / 2 * np.linalg.inv(strength**2 * spread))
        )
    return sorted(peaks, key=lambda peak: -peak.strength)


def fit_echo(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    seed_m: np.ndarray,
    radius_m: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Find the image's maximum near seed_m [3], and the echo of the ball that has its peak there:
    (position [3], samples [f, t, r] of the echo with the strength that fits best).

    The maximum is found by Newton's method on the logarithm of the image's magnitude, whose
    gradient and curvature come from a quadratic through a 3×3×3 stencil.
    """
    tones = ToneSkeleton(frequencies_hz, array, seed_m - REACH_M, seed_m + REACH_M, tolerance=1e-6)
    few = tones.compress(samples)
    position_m = np.asarray(seed_m, np.float64)
    for spacing_m in STENCIL_STEPS_M:
        for _ in range(MAX_STEPS):
            image = np.abs(
                exact_images(
                    few, tones.frequencies_hz, array, position_m + spacing_m * STENCIL, False
                )[0]
            )
            step_m = spacing_m * _summit(np.log(np.maximum(image, np.finfo(np.float32).tiny)))
            position_m = np.clip(position_m + step_m, seed_m - REACH_M, seed_m + REACH_M)
            if np.linalg.norm(step_m) < 0.01 * spacing_m:
                break
    centre_m = ball_centre(position_m, frequencies_hz, array, radius_m, 0.0)
    echo = tones.expand(specular_echo(centre_m, radius_m, tones.frequencies_hz, array))
    return position_m, echo * (np.vdot(echo, samples) / np.vdot(echo, echo))


def ball_centre(
    peak_m: np.ndarray,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    radius_m: float,
    delay_m: float,
) -> np.ndarray:
    """Compute the centre [3], metres, of the ball whose image has its maximum at peak_m. radius_m:
    the ball's radius; delay_m: one-way delay of its foam, as a path.

    The peak is the point whose paths are most similar to the ball's: it minimises the variance of
    k·(path difference) over tones and channels (the common phase is free). The centre is found by
    Gauss–Newton steps.
    """
    centre_m = np.array(peak_m, np.float64)
    for _ in range(4):
        spread, mean_k2, mean_k, gradient, weight = _phase_spread(centre_m, frequencies_hz, array)
        excess = ball_path(centre_m, array, radius_m, delay_m) - path_lengths(array, peak_m)
        pull = mean_k2 * np.einsum("tr,tri,tr->i", weight, gradient, excess)
        pull -= mean_k**2 * np.einsum("tr,tri->i", weight, gradient) * (weight * excess).sum()
        centre_m = centre_m - np.linalg.solve(spread, pull)
    return centre_m


def specular_echo(
    centre_m: np.ndarray, radius_m: float, frequencies_hz: np.ndarray, array: AntennaArray
) -> np.ndarray:
    """Simulate the specular echo of a sphere without foam, or of a point (radius_m = 0): samples
    complex64 [f, t, r]. It is equally strong at all frequencies; the amplitudes of all channels sum
    to 1."""
    phase = phasor(ball_path(centre_m, array, radius_m, 0.0), frequencies_hz[:, None, None], -1)
    return (phase * channel_amplitudes(centre_m, array)).astype(np.complex64)


def ball_path(
    centre_m: np.ndarray, array: AntennaArray, radius_m: float, delay_m: float
) -> np.ndarray:
    """Compute the optical path [t, r], metres, from transmitter to the specular point of a ball in
    foam to receiver: |t − c| + |c − r| − 2a·cos β + 2δ, with the ball's centre c and radius a, half
    the bistatic angle β and the foam's one-way delay δ. The neglected term is a²·sin²β/|c − t|,
    about 1 µm here."""
    return (
        path_lengths(array, centre_m)
        - 2 * radius_m * half_angle_cosine(centre_m, array)
        + 2 * delay_m
    )


def channel_amplitudes(point_m: np.ndarray, array: AntennaArray) -> np.ndarray:
    """Compute the amplitudes of a point's echo, 1/(|p − t||p − r|), scaled to sum 1: [t, r]."""
    to, back = (leg.lengths_m(point_m) for leg in array.legs)
    amplitude = 1 / np.outer(to, back)
    return amplitude / amplitude.sum()


def _phase_spread(
    point_m: np.ndarray, frequencies_hz: np.ndarray, array: AntennaArray
) -> tuple[np.ndarray, float, float, np.ndarray, np.ndarray]:
    """Compute how sharply the echo's phases determine a point's position: the covariance [3, 3] of
    the phase gradient k·g over tones and channels, rad²/m².

    Returns it with its parts: (covariance, mean of k², mean of k, gradient g [t, r, 3] of the path
    lengths, weights [t, r] of the channels).
    """
    k = 2 * np.pi * frequencies_hz / SPEED_OF_LIGHT_M_S
    g = path_gradients(point_m, array)
    weight = channel_amplitudes(point_m, array)
    mean_gg = np.einsum("tr,tri,trj->ij", weight, g, g)
    mean_g = np.einsum("tr,tri->i", weight, g)
    mean_k2, mean_k = float(np.mean(k**2)), float(np.mean(k))
    return mean_k2 * mean_gg - mean_k**2 * np.outer(mean_g, mean_g), mean_k2, mean_k, g, weight


def _summit(values: np.ndarray) -> np.ndarray:
    """Compute the step [3] from the middle of a 3×3×3 stencil towards the maximum of the quadratic
    through its 27 values, in units of the stencil's spacing; at most 2 along each axis."""
    _, x, y, z, xx, yy, zz, xy, xz, yz = QUADRATIC @ values
    hessian = np.array([[2 * xx, xy, xz], [xy, 2 * yy, yz], [xz, yz, 2 * zz]])
    value, vector = np.linalg.eigh(hessian)
    uphill = np.maximum(np.abs(value), 1e-12)  # also if the quadratic has no maximum
    step = vector @ ((vector.T @ [x, y, z]) / uphill)
    return step / max(1.0, np.abs(step).max() / 2)


def _sizes(target: Target) -> dict[tuple[float, float], tuple[int, ...]]:
    """Group the target's elements by size: a dictionary (ball radius, foam delay) in metres →
    indices of the elements with this size."""
    sizes: dict[tuple[float, float], tuple[int, ...]] = {}
    for i, (element, delay_m) in enumerate(zip(target.element, target.foam_delay_m, strict=True)):
        key = (element.ball_radius_m, float(delay_m))
        sizes[key] = (*sizes.get(key, ()), i)
    return sizes
