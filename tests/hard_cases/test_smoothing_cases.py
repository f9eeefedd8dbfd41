"""Hard maps for the averaging filter: holes, borders, lone pixels, long rows, and weights that
differ without end."""

from itertools import product

import numpy as np

from handbench.radar.methods.pixels import masked_mean
from tests.hard_cases.cases import Seen, U, hard_case
from tests.references.balls import Balls, balls, off

LONG = 10_000_000
SUMS = (
    "2k + 10 roundings of 2⁻⁵³ each: k products and k sums along each axis at most, the "
    "offset and the quotient."
)


def _direct(values: np.ndarray, size_px: int, weight: np.ndarray) -> Balls:
    """The filter by its definition at the known pixels [n], every window's sums by themselves."""
    known, half = np.isfinite(values), size_px // 2
    weight = balls(np.where(known, weight, 0))
    sums = []
    for part in (weight * balls(np.where(known, values, 0)), weight):
        for _ in range(2):
            padded = np.pad(part, [(half, half), (0, 0)])
            part = np.sum([padded[at : at + len(part)] for at in range(size_px)], axis=0).T
        sums.append(part[known])
    return np.asarray(sums[0] / sums[1])


def _error(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> float:
    """Largest error over what the roundings of the filter allow; infinite where the holes
    differ."""
    found = masked_mean(values, size_px, weight)
    known = np.isfinite(values)
    if not np.array_equal(np.isfinite(found), known):
        return np.inf
    exact = _direct(values, size_px, np.ones(values.shape) if weight is None else weight)
    allowed = (2 * size_px + 10) * U * np.abs(values[np.isfinite(values)]).max(initial=0.0)
    return float(off(found[known], exact).max() / allowed) if allowed else 0.0


def _map(seed: int, holes: float, shape: tuple[int, int] = (37, 41)) -> np.ndarray:
    generator = np.random.default_rng(seed)
    values = 0.3 + 0.02 * generator.standard_normal(shape)
    values[generator.random(shape) < holes] = np.nan
    return values


@hard_case(
    "masked averages at borders, holes and infinities",
    kind="rigorous",
    bound=1.0,
    unit="1",
    quantity="error of the average, over its roundings",
    reference="direct sums in balls",
    reason=SUMS,
)
def test_holes() -> Seen:
    for size, share in product((1, 3, 5, 9, 31), (0.0, 0.2, 0.9, 0.99)):
        values = _map(size, share)
        values[3, 4], values[20, 20], values[0, 0] = np.inf, -np.inf, np.inf  # holes, too
        weight = np.random.default_rng(size).random(values.shape) + 0.1
        yield f"size {size}, {share:.0%} holes", _error(values, size)
        yield f"size {size}, {share:.0%} holes, weighted", _error(values, size, weight)


@hard_case(
    "sums along 10⁷ samples",
    kind="rigorous",
    bound=1.0,
    unit="1",
    quantity="drift of the average, over its roundings",
    reference="direct sums in balls at 2500 places: borders, the jump, and where a sum in double "
    "is furthest off",
)
def test_drift() -> Seen:
    """2k + 10 roundings of 2⁻⁵³ each: k products and k sums along each axis at most, the offset
    and the quotient; each window is summed by itself, so that nothing adds up along the row's
    10⁷ steps."""
    size, row = 5, 0.3 + 0.02 * np.random.default_rng(0).standard_normal(LONG)
    row[: LONG // 2] += 1e3  # a running sum would keep the rounding of these
    found = masked_mean(row[None], size)[0]
    rough = np.abs(
        found[2:-2] - np.convolve(row, np.ones(size) / size, "valid")
    )  # finds where to look closely
    places = (
        np.argpartition(rough, -1000)[-1000:],
        np.arange(500),
        LONG // 2 + np.arange(-500, 500),
    )
    chosen = 2 + np.unique(np.concatenate(places))
    exact = sum(balls(row[chosen + shift]) for shift in range(-2, 3)) / size
    error = off(found[chosen], exact)
    return [(f"sample {chosen[error.argmax()]}", float(error.max() / ((2 * size + 10) * U * 1e3)))]


@hard_case(
    "lone pixels and empty maps",
    kind="rigorous",
    bound=1.0,
    unit="1",
    quantity="change of what has no neighbour",
    reference="the pixel itself, by direct sums in balls",
    reason=SUMS,
)
def test_lone() -> Seen:
    for size, (y, x) in product((1, 3, 31, 101), ((0, 0), (0, 6), (4, 3), (8, 6))):
        values = np.full((9, 7), np.nan)
        values[y, x] = 0.28
        yield f"size {size}, pixel {y}, {x}", _error(values, size)
    for value, shape in product((0.28, np.nan, np.inf, -np.inf), ((1, 1), (1, 7), (9, 1), (5, 5))):
        yield f"a map {shape} of {value}", _error(np.full(shape, value), 5)


@hard_case(
    "a strong pixel beside weak ones",
    kind="rigorous",
    bound=1.0,
    unit="1",
    quantity="error of the average, over its roundings",
    reference="direct sums in balls",
)
def test_strong_and_weak() -> Seen:
    """2k + 10 roundings of 2⁻⁵³ each: k products and k sums along each axis at most, the offset
    and the quotient: weights are positive and each window is summed by itself, so that no
    rounding of a strong pixel reaches a window without it; float32 images span 166 decades of
    power."""
    for decades, size in product((1, 6, 12, 16, 20, 40, 80, 166, 280), (3, 5, 9)):
        values = _map(decades, 0.1)
        weight = np.full(values.shape, 10.0**-decades)
        weight[::11, ::13] = 1.0
        yield f"10^{decades}, size {size}", _error(values, size, weight)
