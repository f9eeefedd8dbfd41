"""The model that self-calibration fits: echoes of a few bright points, seen by an instrument whose
range offset, scan step or gains are unknown; and the fit, by least squares.

A channel with gain g records at the tone f the sum
Σ a·g·exp(−j2πf·(|p − t| + |p − r| + 2·offset)/c) over points p with echoes a, with its transmitter
t and its receiver r at the scan's true steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handbench.calibration.echoes.channels import CaptureChannels
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S

# standard deviations expected beforehand of a log gain, the offset in metres, a step's share: wide,
# they only hold what the echoes leave open
EXPECTED = {"gains": 3.0, "range_offset": 1.0, "scan_step": 0.1}
EACH = 5  # unknowns of a point: x, y, z, and its echo's log level and phase
SETTLED = 0.01  # of one standard deviation squared: a step that gains less ends the fit
DAMPING = 1e-3, 1e8  # of the first step, and at which no step helps


@dataclass(frozen=True)
class Points:
    """Values of all unknowns: log_gains, complex [parts] for each side; the range offset in metres;
    steps [2], by which shares the scan's steps along x and y are larger than recorded; the points'
    positions place_m [k, 3] and complex echoes [k]."""

    log_gains: tuple[np.ndarray, ...]
    offset_m: float
    steps: np.ndarray
    place_m: np.ndarray
    echoes: np.ndarray

    @classmethod
    def none(cls, channels: CaptureChannels) -> Points:
        """Return no points, before an instrument without errors."""
        log_gains = tuple(np.zeros(side.count, np.complex128) for side in channels.sides)
        return cls(log_gains, 0.0, np.zeros(2), np.zeros((0, 3)), np.zeros(0, np.complex128))

    def with_point(self, place_m: np.ndarray, echo: complex) -> Points:
        """Return the same with one more point."""
        places_m = np.concatenate([self.place_m, place_m[None]])
        return replace(self, place_m=places_m, echoes=np.append(self.echoes, echo))

    def strongest(self, count: int) -> Points:
        """Return the same with the `count` strongest points only."""
        kept = np.argsort(-np.abs(self.echoes), kind="stable")[:count]
        return replace(self, place_m=self.place_m[kept], echoes=self.echoes[kept])


@dataclass(frozen=True)
class Fit:
    """A fit: the values, the normal equations JᵀJ [u, u] and Jᵀρ [u] of its residual ρ, the share
    of each point in the gradient of the shared unknowns, scores [k, shared], the residual's power a
    sample, and the cost that the fit lowers."""

    points: Points
    normal: np.ndarray
    right: np.ndarray
    scores: np.ndarray
    noise: float
    cost: float


@dataclass(frozen=True)
class PointModel:
    """Samples [f, n] at frequencies_hz [f] (equivalent ones of vacuum) of channels, which of
    "gains", "range_offset", "scan_step" are unknown, and the range, with its offset, near which the
    samples hold echoes. The vector of unknowns has those that all points share first: real and
    imaginary part of each side's log gains, offset, steps."""

    samples: np.ndarray
    frequencies_hz: np.ndarray
    channels: CaptureChannels
    unknown: frozenset[str]
    range_m: float

    @cached_property
    def axes(self) -> list[int]:
        """The axes along which the scan's step is unknown."""
        moved = np.ptp(self.channels.moves_m[:, :2], axis=0) > 0
        return np.flatnonzero(moved).tolist() if "scan_step" in self.unknown else []

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where the shared unknowns are in the vector: by the names in `unknown`."""
        counts = {
            "gains": 2 * sum(side.count for side in self.channels.sides),
            "range_offset": 1,
            "scan_step": len(self.axes),
        }
        found, end = {}, 0
        for name, count in counts.items():
            if name in self.unknown:
                found[name] = slice(end, end + count)
                end += count
        return found

    @cached_property
    def shared(self) -> int:
        """The number of shared unknowns."""
        return max((place.stop for place in self.places.values()), default=0)

    def expected(self) -> np.ndarray:
        """Inverse variances [shared] of what is expected beforehand."""
        weights = np.empty(self.shared)
        for name, place in self.places.items():
            weights[place] = EXPECTED[name] ** -2
        return weights

    def values(self, points: Points) -> np.ndarray:
        """Return the shared unknowns as a vector [shared]."""
        log_gains = [part for gain in points.log_gains for part in (gain.real, gain.imag)]
        of = {
            "gains": np.concatenate(log_gains),
            "range_offset": [points.offset_m],
            "scan_step": points.steps[self.axes],
        }
        return np.concatenate([of[name] for name in self.places] or [np.empty(0)])

    def moved(self, points: Points, step: np.ndarray) -> Points:
        """Return the values after a step [u] of the vector of unknowns."""
        places, log_gains = self.places, list(points.log_gains)
        if "gains" in places:
            sizes = [len(g) for g in log_gains for _ in range(2)]
            parts = np.split(step[places["gains"]], np.cumsum(sizes)[:-1])
            log_gains = [
                g + level + 1j * phase
                for g, level, phase in zip(log_gains, parts[::2], parts[1::2], strict=True)
            ]
        offset_m, steps = points.offset_m, points.steps.copy()
        if "range_offset" in places:
            offset_m += float(step[places["range_offset"]][0])
        if "scan_step" in places:
            steps[self.axes] += step[places["scan_step"]]
        each = step[self.shared :].reshape(-1, EACH)
        return Points(
            tuple(log_gains),
            offset_m,
            steps,
            points.place_m + each[:, :3],
            points.echoes * np.exp(each[:, 3] + 1j * each[:, 4]),
        )

    def terms(self, points: Points) -> Iterator[tuple[float, np.ndarray]]:
        """Yield, tone by tone, the wavenumber and each point's contribution, complex [k, n]."""
        channels = self.channels.stretched(points.steps)
        gain = channels.spread([np.exp(g) for g in points.log_gains])
        path_m = _path_m(channels, points.place_m) + 2 * points.offset_m
        for wavenumber in 2 * np.pi * self.frequencies_hz / SPEED_OF_LIGHT_M_S:
            yield wavenumber, points.echoes[:, None] * gain * np.exp(-1j * wavenumber * path_m)

    def residual(self, points: Points) -> np.ndarray:
        """Return what the points do not explain: samples − model, [f, n]."""
        return self.samples - np.array([terms.sum(axis=0) for _, terms in self.terms(points)])

    def focused(self, samples: np.ndarray, points: Points) -> tuple[np.ndarray, CaptureChannels]:
        """Return samples [f, n] as an instrument without errors records them, by the estimates in
        `points`, and its channels."""
        gain = self.channels.spread([np.exp(g) for g in points.log_gains])
        turn = 4 * np.pi * self.frequencies_hz * points.offset_m / SPEED_OF_LIGHT_M_S
        return samples / gain * np.exp(1j * turn)[:, None], self.channels.stretched(points.steps)

    def normal_equations(self, points: Points) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Compute the normal equations of the residual ρ: JᵀJ [u, u], Jᵀρ [u], each point's share
        [k, shared] of the latter, and the power of ρ."""
        along = _slopes(self.channels.stretched(points.steps), points.place_m)  # [k, n, 3]
        size = self.shared + EACH * len(points.echoes)
        columns = np.empty((size, self.samples.shape[1]), np.complex128)
        normal, right, power = np.zeros((size, size)), np.zeros(size), 0.0
        scores = np.zeros((len(points.echoes), self.shared))
        for samples, (wavenumber, terms) in zip(self.samples, self.terms(points), strict=True):
            rest = samples - terms.sum(axis=0)
            shared = self._shared_columns(wavenumber, terms, along)
            for i, (own, place) in enumerate(zip(shared, along, strict=True)):
                scores[i] += (own @ rest.conj()).real
                each = columns[self.shared + EACH * i :][:EACH]
                each[:3] = -1j * wavenumber * terms[i] * place.T
                each[3], each[4] = terms[i], 1j * terms[i]
            columns[: self.shared] = sum(shared)
            real = columns.view(np.float64)
            normal += real @ real.T
            right += real @ rest.view(np.float64)
            power += float(np.vdot(rest, rest).real)
        return normal, right, scores, power

    def _shared_columns(
        self, wavenumber: float, terms: np.ndarray, along: np.ndarray
    ) -> list[np.ndarray]:
        """Derivatives of each point's contribution terms [k, n] at one tone by the shared unknowns:
        k arrays [shared, n]. along [k, n, 3]: of the path by the point's position."""
        found = []
        for term, slope in zip(terms, along, strict=True):
            columns = np.zeros((self.shared, len(term)), np.complex128)
            places = self.places
            if "gains" in places:
                at = 0
                for side in self.channels.sides:
                    columns[at + side.of, np.arange(len(term))] = term
                    columns[at + side.count + side.of, np.arange(len(term))] = 1j * term
                    at += 2 * side.count
            if "range_offset" in places:
                columns[places["range_offset"]] = -2j * wavenumber * term
            if "scan_step" in places:
                moves = (slope * self.channels.moves_m).T[self.axes]
                columns[places["scan_step"]] = 1j * wavenumber * moves * term
            found.append(columns)
        return found

    def fit(self, points: Points, iterations: int) -> Fit:
        """Fit all unknowns by damped Gauss-Newton steps (Levenberg and Marquardt), the shared ones
        with what is expected of them beforehand."""
        weights, damping = self.expected(), DAMPING[0]
        now = self._fitted(points, weights)
        for _ in range(iterations):
            matrix, right = now.normal.copy(), now.right.copy()
            on = np.arange(self.shared)
            matrix[on, on] += now.noise * weights
            right[on] -= now.noise * weights * self.values(now.points)
            scale = scales(matrix)
            damped = matrix / scale[:, None] / scale + damping * np.eye(len(scale))
            step = np.linalg.solve(damped, right / scale) / scale
            new = self._fitted(self.moved(now.points, step), weights)
            if new.cost < now.cost:
                settled = now.cost - new.cost < SETTLED * now.noise
                now, damping = new, damping / 10
                if settled:
                    break
            else:
                damping = max(10 * damping, DAMPING[0])
                if damping > DAMPING[1]:
                    break
        return now

    def _fitted(self, points: Points, weights: np.ndarray) -> Fit:
        normal, right, scores, power = self.normal_equations(points)
        noise = power / max(2 * self.samples.size - len(right), 1)  # of a real or imaginary part
        cost = power + noise * float(weights @ self.values(points) ** 2)
        return Fit(points, normal, right, scores, noise, cost)


def scales(matrix: np.ndarray) -> np.ndarray:
    """Return the factors [u] that scale a normal matrix to a diagonal of 1: the roots of its
    diagonal, 1 where that is 0."""
    diagonal = np.diag(matrix)
    return np.sqrt(np.where(diagonal > 0, diagonal, 1.0))


def _path_m(channels: CaptureChannels, place_m: np.ndarray) -> np.ndarray:
    """Length of each channel's path over points [k, 3]: [k, n], metres."""
    ends = (np.linalg.norm(place_m[:, None] - end_m, axis=2) for end_m in _ends(channels))
    return np.asarray(sum(ends))


def _slopes(channels: CaptureChannels, place_m: np.ndarray) -> np.ndarray:
    """Derivatives of the paths by the points' positions: [k, n, 3]."""
    away = (place_m[:, None] - end_m for end_m in _ends(channels))
    return np.asarray(sum(way / np.linalg.norm(way, axis=2, keepdims=True) for way in away))


def _ends(channels: CaptureChannels) -> tuple[np.ndarray, np.ndarray]:
    return channels.tx_m, channels.rx_m
