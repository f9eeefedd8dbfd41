"""Self-calibration: range offset, scan step and gains of a capture from its own echoes.

The path over a point bends over the aperture by how near the point is and by how far the antennas
are apart; its length is the range. So curvature and range of a few bright points hold the range
offset or the scan step, points at several ranges both. Points are sought in the image of what the
earlier ones leave unexplained, the brightest first; all are fitted together.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from handbench.calibration.echoes.channels import CaptureChannels
from handbench.calibration.echoes.corrections import Corrections, Unknown
from handbench.calibration.echoes.points import EACH, Fit, PointModel, Points, scales
from handbench.radar.data.arrays import (
    SPEED_OF_LIGHT_M_S,
    AntennaArray,
    BistaticScan,
    range_cell_m,
    range_period_m,
)
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.radar.imaging.api import image_points
from handbench.support.errors import HandbenchError
from handbench.support.progress import track

MOST_TONES, MOST_CHANNELS = 32, 4000  # that are fitted; evenly chosen
MOST_POINTS = 8
SEARCHED = 256  # channels by whose image points are looked for
PROMISING = 200  # points of it that are imaged by all channels
VIEW = 0.6  # tangent of the angle off the axis up to which points are sought
MOST_DIRECTIONS = 101  # along x and y
OTHER_STEPS = [(x, y) for x in (0.94, 1.0, 1.06) for y in (0.94, 1.0, 1.06) if (x, y) != (1, 1)]
SOME_STEPS, MOST_STEPS = 8, 60  # of a fit while points are added, and of the last one
CHANCE = 3.0  # a peak that noise shows with a probability of exp(−3) is a point
MOST_PEAKS = 4  # of an image that are tried as the first point
PEAK_CELLS = 2.0  # resolution cells by which they are apart
NEAREST_M, BEHIND_M = 0.05, 0.6  # depths searched: from there to so far behind the apparent range
STEP_FACTORS = np.geomspace(0.5, 2.0, 57)  # of the scan's step that are tried first
MOST_STEP = 0.05  # half-width of a step's 95 % interval up to which it is determined
MOST_PHASE_RAD = 0.5  # standard deviation of a gain's phase up to which gains are determined
LEAST_EXPLAINED = 0.8  # share of the power that points explain, unless the rest is noise
BLURRED_DB = 0.5  # loss of the strongest echo from which the fit is taken to be wrong
INSEPARABLE = 0.95  # correlation of two estimates from which the echoes cannot tell them apart
WIDE_95 = 1.96


@dataclass(frozen=True)
class Estimate:
    """An estimated number with its standard deviation and the half-width of its 95 % interval;
    whether that is narrow enough to correct a capture by it."""

    value: float
    sigma: float
    half_width: float
    determined: bool


@dataclass(frozen=True)
class SelfCalibration:
    """What a capture's echoes say of its instrument.

    estimates: by name, range_offset_m, scan_step_x, scan_step_y (factors), first_depth_m (of the
    strongest point). corrections: those of them that are determined. log_gains: complex [parts] for
    each side, without common gain. gain_sigma: standard deviation of their level and phase, after
    taking off what a shift of the target imitates; None without gains. inseparable: pairs of names
    that the echoes cannot tell apart. period_m: the range offset is known up to multiples of it.
    points: number of points; explained: their share of the echoes' power; noise_left: the rest is
    noise, not further echoes. sharper_db: by how much the strongest echo grew.
    """

    estimates: dict[str, Estimate]
    corrections: Corrections
    log_gains: tuple[np.ndarray, ...]
    gain_sigma: float | None
    inseparable: list[tuple[str, str]]
    period_m: float
    points: int
    explained: float
    noise_left: bool
    sharper_db: float


def self_calibrate(capture: RadarCapture, unknown: Iterable[Unknown]) -> SelfCalibration:
    """Estimate what is unknown of a capture's instrument from its first frame's echoes. Raises
    HandbenchError if no echo stands out from the noise, or nothing unknown can be estimated."""
    asked = frozenset(unknown)
    _require_sense(capture, asked)
    model = _model(capture, asked)
    start = _start(model)
    fit, noise_left = _with_points(model, start)
    covariance = _covariance(model, fit)
    return _result(
        model,
        fit,
        covariance,
        noise_left,
        range_period_m(capture.frequencies_hz) * capture.wave_speed_m_s / SPEED_OF_LIGHT_M_S,
    )


def _require_sense(capture: RadarCapture, unknown: frozenset[str]) -> None:
    moved = not isinstance(capture.aperture, AntennaArray)
    if not unknown:
        raise HandbenchError(
            "unknown: is empty; list in capture.toml what to estimate, e.g. unknown = "
            '["range_offset", "scan_step", "gains"]'
        )
    if "scan_step" in unknown and not moved:
        raise HandbenchError(
            'unknown: holds "scan_step", but the array does not move; remove it from capture.toml'
        )
    if not moved and {"range_offset", "gains"} <= unknown:
        raise HandbenchError(
            'unknown: holds "range_offset" and "gains" of an array that does not move, whose gains '
            "imitate what shows the offset; remove one of them from capture.toml"
        )
    if len(np.unique(capture.frequencies_hz)) < 2:
        raise HandbenchError("echoes: have one tone; expected two or more, which give the range")


def _model(capture: RadarCapture, unknown: frozenset[str]) -> PointModel:
    """Choose tones and channels of the first frame and return their model."""
    order = np.argsort(capture.frequencies_hz)
    samples = capture.samples[0].reshape(len(order), -1)[order]
    live = np.flatnonzero(samples.any(axis=0))
    if len(live) == 0:
        raise HandbenchError("echoes, frame 0: are all 0; record them again")
    # a random choice of pairs has every antenna, and no pattern that shows as a ghost
    if len(live) > MOST_CHANNELS:
        live = np.sort(np.random.default_rng(0).choice(live, MOST_CHANNELS, replace=False))
    waves = capture.frequencies_hz[order] * (SPEED_OF_LIGHT_M_S / capture.wave_speed_m_s)
    chosen = scaled_to_one(samples[:, live]).astype(np.complex128)
    ranges_m = np.arange(range_cell_m(waves) / 4, range_period_m(waves), range_cell_m(waves) / 4)
    range_m = ranges_m[_range_profile(chosen, waves, ranges_m).argmax()]
    channels = CaptureChannels.of(capture.aperture).some(live)
    return PointModel(*_gated(chosen, waves, range_m), channels, unknown, float(range_m))


def _gated(
    samples: np.ndarray, frequencies_hz: np.ndarray, range_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Average samples [f, n] over groups of neighbouring tones, at most MOST_TONES of them, so that
    echoes near range_m stay and those far from it are lost: (samples, mean frequencies)."""
    groups = np.array_split(np.arange(len(samples)), min(len(samples), MOST_TONES))
    turned = _turned(frequencies_hz, range_m)[:, None] * samples
    means_hz = np.array([frequencies_hz[group].mean() for group in groups])
    means = np.array([turned[group].mean(axis=0) for group in groups])
    return means / _turned(means_hz, range_m)[:, None], means_hz


def _start(model: PointModel) -> Points:
    """Return no points, with the range offset at which the strongest echo is sharpest; or the scan
    step, if that alone is unknown."""
    start, range_m = Points.none(model.channels), model.range_m
    index = even_subset(model.samples.shape[1], SEARCHED)
    if "range_offset" in model.unknown:
        depths_m = _start_depths_m(model, range_m)
        tried = [replace(start, offset_m=range_m - depth_m) for depth_m in depths_m]
    elif "scan_step" in model.unknown:
        tried = [replace(start, steps=np.full(2, factor - 1)) for factor in STEP_FACTORS]
    else:
        return start
    peaks, directions, centre_m = [], _directions(model), _centre_m(model)
    for points in track(tried, "looking for the sharpest image"):
        samples, channels = model.focused(model.samples, points)
        at_m = directions * (range_m - points.offset_m) + centre_m
        image = _image(model, samples, channels, at_m, index)
        peaks.append(np.abs(image).max())
    return tried[int(np.argmax(peaks))]


def _start_depths_m(model: PointModel, range_m: float) -> np.ndarray:
    """Depths that the target may have, a depth of focus apart."""
    wavelength_m = _wavelength_m(model)
    nearest_m = max(NEAREST_M, 2 * wavelength_m)
    depths_m = [nearest_m]
    while depths_m[-1] < max(range_m + BEHIND_M, 1.0):
        focus_m = 2 * wavelength_m * (depths_m[-1] / model.channels.width_m) ** 2
        depths_m.append(depths_m[-1] + max(focus_m, nearest_m / 5))
    return np.array(depths_m)


def _with_points(model: PointModel, start: Points) -> tuple[Fit, bool]:
    """Add the strongest point of what the earlier ones leave unexplained, and fit all, until only
    noise is left or there are MOST_POINTS: (last fit, whether noise is left)."""
    points = start
    for count in track(range(MOST_POINTS), "fitting points"):
        found = _peaks(model, model.residual(points), points)
        if not found:
            break
        # with unknown gains a side lobe may be the highest peak: so the first is tried at several
        tried = found if count == 0 else found[:1]
        points = _best(model, [points.with_point(*peak) for peak in tried], several=count < 2)
    if not len(points.echoes):
        raise HandbenchError(
            "echoes: none stands out from the noise; put a small bright target, such as a metal "
            "ball or a corner, before the antennas"
        )
    # points that were needed on the way to the values may not be needed with them
    for count in range(1, len(points.echoes) + 1):
        fit = model.fit(_best(model, [points.strongest(count)], several=True), MOST_STEPS)
        if not _peaks(model, model.residual(fit.points), fit.points):
            return fit, True
    return fit, False


def _best(model: PointModel, starts: list[Points], several: bool) -> Points:
    """Fit all unknowns from each start, and return the values that leave the least. several: start
    from other steps of the scan, too, if offset and steps are both unknown, since a fit may end
    beside the best values."""
    if several and {"range_offset", "scan_step"} <= model.unknown:
        starts = starts + [
            _with_steps(start, model, np.array(steps)) for start in starts for steps in OTHER_STEPS
        ]
    fits = [model.fit(start, SOME_STEPS) for start in starts]
    return min(fits, key=lambda fit: fit.noise).points


def _with_steps(points: Points, model: PointModel, factors: np.ndarray) -> Points:
    """Return values with the scan's steps multiplied by factors [2] and points moved so that paths
    bend as before and are as long: z grows with the square of the steps, tangents of the directions
    shrink with them, and the range offset takes up the rest."""
    centre_m = _centre_m(model)
    away_m = points.place_m - centre_m
    range_m = np.linalg.norm(away_m, axis=1)
    towards = away_m / range_m[:, None]
    towards[:, :2] /= factors
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    offset_m = float(range_m[0] * (1 - factors.prod()))
    place_m = centre_m + towards * (range_m - offset_m)[:, None]
    steps = (1 + points.steps) * factors - 1
    return replace(points, offset_m=points.offset_m + offset_m, steps=steps, place_m=place_m)


def _peaks(model: PointModel, rest: np.ndarray, points: Points) -> list[tuple[np.ndarray, complex]]:
    """Find the highest peaks, at most MOST_PEAKS, in the image of samples that are not yet
    explained: a list of (position [3], echo), highest first; empty if noise alone may be as
    strong."""
    samples, channels = model.focused(rest, points)
    shell_m = _range_m(model, samples, points.offset_m)
    shells_m = shell_m + range_cell_m(model.frequencies_hz) * np.array([-0.5, 0, 0.5])
    directions, centre_m = _directions(model), _centre_m(model)
    at_m = np.concatenate([directions * shell + centre_m for shell in shells_m])
    rough = _image(model, samples, channels, at_m, even_subset(samples.shape[1], SEARCHED))
    best_m = at_m[np.argsort(np.abs(rough))[-PROMISING:]]
    image = _image(model, samples, channels, best_m)
    noise = float((np.abs(samples) ** 2).mean())
    stands_out = np.abs(image).max() ** 2 / (samples.size * noise)
    if stands_out < np.log(len(at_m) * len(samples)) + CHANCE:
        return []
    apart_m = PEAK_CELLS * shell_m * _wavelength_m(model) / (2 * model.channels.width_m)
    peaks: list[tuple[np.ndarray, complex]] = []
    for i in np.argsort(-np.abs(image)):
        if all(np.linalg.norm(best_m[i] - place_m) > apart_m for place_m, _ in peaks):
            peaks.append((best_m[i], complex(image[i] / samples.size)))
    return peaks[:MOST_PEAKS]


def _image(
    model: PointModel,
    samples: np.ndarray,
    channels: CaptureChannels,
    at_m: np.ndarray,
    index: np.ndarray | slice = slice(None),
) -> np.ndarray:
    """Image samples [f, n] at points at_m [k, 3] by the channels with these indices: [k]."""
    some = channels.some(np.arange(samples.shape[1])[index])
    pairs = BistaticScan(some.tx_m, some.rx_m)
    chosen = samples[:, index].astype(np.complex64)
    return image_points(chosen, model.frequencies_hz, pairs, at_m, None)


def _directions(model: PointModel) -> np.ndarray:
    """Unit vectors [n, 3] towards where points are sought, less than a resolution cell apart."""
    wavelength_m = _wavelength_m(model)
    count = int(2 * np.ceil(1.5 * VIEW * model.channels.width_m / wavelength_m) + 1)
    tangents = np.linspace(-VIEW, VIEW, min(count, MOST_DIRECTIONS))
    x, y = (axis.ravel() for axis in np.meshgrid(tangents, tangents))
    towards = np.stack([x, y, np.ones_like(x)], axis=1)
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)


def _wavelength_m(model: PointModel) -> float:
    return SPEED_OF_LIGHT_M_S / float(model.frequencies_hz.mean())


def _centre_m(model: PointModel) -> np.ndarray:
    return model.channels.middle_m.mean(axis=0)


def _turned(frequencies_hz: np.ndarray, ranges_m: np.ndarray | float) -> np.ndarray:
    """Factors exp(+j4πf·range/c) that undo the phase of an echo: [..., f]."""
    waves = np.multiply.outer(ranges_m, frequencies_hz) / SPEED_OF_LIGHT_M_S
    return np.exp(4j * np.pi * waves)


def _range_profile(
    samples: np.ndarray, frequencies_hz: np.ndarray, ranges_m: np.ndarray
) -> np.ndarray:
    """Power of the samples [f, n] at each range (half the path), summed over the channels."""
    return (np.abs(_turned(frequencies_hz, ranges_m) @ samples) ** 2).sum(axis=1)


def _range_m(model: PointModel, samples: np.ndarray, offset_m: float) -> float:
    """Range of the strongest echo in samples [f, n] of the model that are free of a range
    offset."""
    tones_hz = model.frequencies_hz
    half_m, step_m = range_period_m(tones_hz) / 2, range_cell_m(tones_hz) / 4
    ranges_m = model.range_m - offset_m + np.arange(-half_m, half_m, step_m)
    ranges_m = ranges_m[ranges_m > step_m]
    return float(ranges_m[_range_profile(samples, tones_hz, ranges_m).argmax()])


def _covariance(model: PointModel, fit: Fit) -> np.ndarray:
    """Compute the covariance [u, u] of all unknowns: that of white noise of the residual's power;
    for the shared unknowns of three or more points that from the scatter between the points, where
    it is larger, since weak echoes around a point disturb it in its own way (the cluster-robust
    estimator)."""
    on, shared = np.arange(model.shared), slice(None, model.shared)
    matrix = fit.normal / fit.noise
    matrix[on, on] += model.expected()
    scale = scales(matrix)
    covariance = np.linalg.pinv(matrix / scale[:, None] / scale, hermitian=True) / scale
    covariance = covariance / scale[:, None]
    count = len(fit.scores)
    if count < 3:
        return covariance
    scores = (fit.scores - fit.scores.mean(axis=0)) / fit.noise
    among = scores.T @ scores * count / (count - 1)
    robust = covariance[shared, shared] @ among @ covariance[shared, shared]
    larger = np.maximum(np.diag(robust) / np.diag(covariance)[shared], 1.0)
    grown = np.ones(len(covariance))
    grown[shared] = np.sqrt(larger)
    return covariance * grown * grown[:, None]


def _result(
    model: PointModel, fit: Fit, covariance: np.ndarray, noise_left: bool, period_m: float
) -> SelfCalibration:
    """Judge which estimates are determined, and turn those into corrections."""
    points, places, count = fit.points, model.places, len(fit.points.echoes)
    sharper_db = _sharper_db(model, points)
    explained = 1 - float(
        (np.abs(model.residual(points)) ** 2).sum() / (np.abs(model.samples) ** 2).sum()
    )
    # flat and long targets bend the paths in other ways than points do
    few = noise_left or explained >= LEAST_EXPLAINED
    trusted = few and sharper_db > -BLURRED_DB
    wide = WIDE_95 if noise_left else float(special.stdtrit(max(count - 1, 1), 0.975))
    sigmas = np.sqrt(np.diag(covariance))

    def estimate(value: float, at: int, most: float) -> Estimate:
        half_width = wide * float(sigmas[at])
        return Estimate(value, float(sigmas[at]), half_width, half_width <= most and trusted)

    estimates, at = {}, {}
    if "range_offset" in places:
        at["range_offset_m"] = places["range_offset"].start
        offset_m = points.offset_m - period_m * np.rint(points.offset_m / period_m)
        estimates["range_offset_m"] = estimate(
            offset_m, at["range_offset_m"], range_cell_m(model.frequencies_hz) / 2
        )
    for i, axis in enumerate(model.axes):
        name = f"scan_step_{'xy'[axis]}"
        at[name] = places["scan_step"].start + i
        estimates[name] = estimate(1 + points.steps[axis], at[name], MOST_STEP)
    strongest = int(np.abs(points.echoes).argmax())
    at["first_depth_m"] = model.shared + EACH * strongest + 2
    depth_m = float(points.place_m[strongest, 2])
    estimates["first_depth_m"] = estimate(depth_m, at["first_depth_m"], np.inf)
    log_gains, gain_sigma = _gains(model, points, covariance)
    kept = {name: found for name, found in estimates.items() if found.determined}
    corrections = Corrections(
        range_offset_m=kept["range_offset_m"].value if "range_offset_m" in kept else 0.0,
        scan_step=tuple(
            kept[name].value if (name := f"scan_step_{axis}") in kept else 1.0 for axis in "xy"
        ),
        gains=()
        if gain_sigma is None or gain_sigma > MOST_PHASE_RAD or not trusted
        else tuple(tuple((g.real, g.imag) for g in np.exp(side).tolist()) for side in log_gains),
    )
    return SelfCalibration(
        estimates,
        corrections,
        log_gains,
        gain_sigma,
        _inseparable(covariance, at),
        period_m,
        count,
        explained,
        noise_left,
        sharper_db,
    )


def _gains(
    model: PointModel, points: Points, covariance: np.ndarray
) -> tuple[tuple[np.ndarray, ...], float | None]:
    """Return each side's log gains without their mean, and the standard deviation of one's level
    and phase, root mean square over the parts, without what a shift of the target imitates: a
    phase that is the same or grows in proportion to the parts' place."""
    log_gains = tuple(gains - gains.mean() for gains in points.log_gains)
    if "gains" not in model.unknown or all(len(gains) < 2 for gains in log_gains):
        return log_gains, None
    variance, freedom, at = 0.0, 0, 0
    for side in model.channels.sides:
        own = covariance[at : at + 2 * side.count, at : at + 2 * side.count]
        phases = own[side.count :, side.count :]
        imitated = np.column_stack([np.ones(side.count), side.place_m])
        basis, strengths, _ = np.linalg.svd(imitated, full_matrices=False)
        basis = basis[:, strengths > 1e-9 * strengths[0]]
        left = np.eye(side.count) - basis @ basis.T
        variance += float(np.trace(left @ phases @ left))
        freedom += side.count - basis.shape[1]
        at += 2 * side.count
    return log_gains, float(np.sqrt(variance / freedom)) if freedom else None


def _inseparable(covariance: np.ndarray, at: dict[str, int]) -> list[tuple[str, str]]:
    """Name the pairs of estimates whose errors move together."""
    names, index = list(at), list(at.values())
    own = covariance[np.ix_(index, index)]
    correlation = own / np.sqrt(np.outer(np.diag(own), np.diag(own)))
    pairs = np.argwhere(np.triu(np.abs(correlation) > INSEPARABLE, 1))
    return [(names[i], names[j]) for i, j in pairs]


def _sharper_db(model: PointModel, points: Points) -> float:
    """By how many decibels the strongest pixel of the image grew, relative to the samples' power,
    by the estimates in `points`."""
    peaks = []
    for values in (Points.none(model.channels), points):
        samples, channels = model.focused(model.samples, values)
        range_m = _range_m(model, samples, values.offset_m)
        at_m = _directions(model) * range_m + _centre_m(model)
        rough = _image(model, samples, channels, at_m)
        best_m = at_m[np.abs(rough).argmax()]
        apart_m = np.linalg.norm(at_m - best_m, axis=1)
        near_m = np.sort(apart_m)[1] * np.linspace(-1, 1, 9)
        deep_m = range_cell_m(model.frequencies_hz) * np.linspace(-1, 1, 17)
        cube_m = np.stack(np.meshgrid(near_m, near_m, deep_m), axis=-1).reshape(-1, 3)
        fine = _image(model, samples, channels, best_m + cube_m)
        peaks.append(np.abs(fine).max() / np.sqrt((np.abs(samples) ** 2).mean()))
    return float(20 * np.log10(peaks[1] / peaks[0]))
