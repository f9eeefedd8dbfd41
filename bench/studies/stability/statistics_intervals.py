"""Hard cases of intervals and tests: three captures, three repeats, p-values that underflow, ties, any size."""

from itertools import combinations, product
from math import sqrt

import numpy as np
from scipy.special import erf

from bench.evaluation.statistics.intervals import mean_interval, precision_interval
from bench.evaluation.statistics.paired import corrected, paired
from bench.results.error_map import ErrorMap
from bench.studies.stability.cases import Seen

EPS = np.finfo(float).eps
DEPTH_M, PIXEL_M = 0.3, 1e-3
T4 = 2.7764451051977987  # 97.5 % of Student's t with four degrees of freedom, from tables
BOUNDS = {"tiny_p": EPS**0.5}


def told(figure: float | None) -> float:
    """The figure; NaN, which no bound allows, where none is given."""
    return np.nan if figure is None else figure


def a_map(error_m: np.ndarray, pixel_m: float = PIXEL_M) -> ErrorMap:
    """Errors [ny, nx] on a reference at DEPTH_M."""
    y_m, x_m = (pixel_m * np.arange(n) for n in error_m.shape)
    return ErrorMap(x_m, y_m, error_m, np.full(error_m.shape, DEPTH_M))


def _five_captures() -> Seen:
    """Figures that lie evenly about their mean: without skewness Hall's interval is Student's."""
    for relative, mean in product((1e-9, 1e-6, 1e-3, 0.1, 0.9), (1e-6, 1.0, 1e6)):
        values = mean * (1 + relative * np.array([-1.0, -0.5, 0.0, 0.5, 1.0]))
        reach = T4 * np.sqrt(5 / 8) * relative * mean / sqrt(5)
        found = mean_interval(values) or (np.nan, np.nan)
        for end, wanted in zip(found, (mean - reach, mean + reach), strict=True):
            yield f"{mean:g} ± {relative:g}", float(abs(end - wanted) / (EPS * mean))


def _correlated_repeats() -> Seen:
    """Three hands, ten repeats each, of which neighbours have a correlation of ρ (AR 1)."""
    rng, trials = np.random.default_rng(0), 300
    for rho in (0.0, 0.7):
        z_m, hits = rng.standard_normal((10, trials, 3)), 0
        for k in range(1, 10):
            z_m[k] = rho * z_m[k - 1] + sqrt(1 - rho**2) * z_m[k]
        for trial in range(trials):
            interval = precision_interval(list(1e-3 * z_m[:, trial].T), trial)
            hits += interval is not None and interval.low <= 1 <= interval.high
        yield f"ρ = {rho}", abs(100 * hits / trials - 95)


def _coverage() -> float:
    """Mean absolute errors of captures whose bias is normal, 0.7 mm, beside 0.5 mm of noise: skewed figures."""
    rng, trials, noise, bias_mm = np.random.default_rng(0), 4000, 0.5, 0.7

    def folded_mm(bias: np.ndarray) -> np.ndarray:  # mean of |normal| about a bias
        return noise * np.sqrt(2 / np.pi) * np.exp(-(bias**2) / (2 * noise**2)) + bias * erf(bias / noise / sqrt(2))

    true_mm = np.hypot(noise, bias_mm) * sqrt(2 / np.pi)
    found = [mean_interval(figures) for figures in folded_mm(bias_mm * rng.standard_normal((trials, 10)))]
    return abs(100 * sum(interval.low <= true_mm <= interval.high for interval in found if interval) / trials - 95)


def _student(t: float) -> float:
    """Two-sided p of four degrees of freedom in closed form, without cancellation."""
    root = float(np.hypot(t, 2))
    gap = 4 / root / (root + t)  # 1 − u, u = t/√(t² + 4); p = 1 − u(3 − u²)/2 = (1 − u)²(2 + u)/2
    return gap**2 * (3 - gap) / 2


def _tiny_p() -> Seen:
    apart = np.array([-1.0, -0.5, 0.0, 0.5, 1.0]) / np.sqrt(5 / 8)  # deviation 1
    for t in (*np.logspace(-9, 3, 37), 37.0, 1e5, 1e8):
        wanted, found = _student(t), paired(np.zeros(5), t / sqrt(5) + apart).p
        yield f"t = {t:g}", abs(found - wanted) / wanted if 0 <= found <= 1 else np.inf
    yield "no spread, a difference", paired(np.zeros(5), np.full(5, 1e-3)).p
    yield "no difference", 1 - paired(np.ones(5), np.ones(5)).p


def _ties() -> Seen:
    def closed(p: list[float]) -> list[float]:
        sets = [s for size in range(1, len(p) + 1) for s in combinations(range(len(p)), size)]
        return [max(min(len(s) * min(p[k] for k in s), 1.0) for s in sets if i in s) for i in range(len(p))]

    rng = np.random.default_rng(0)
    chosen = np.array([0.0, 5e-324, 1e-300, 0.01, 0.0125, 0.05, 0.5, 1.0])
    lists = [[], [0.0], [1.0] * 6, [0.01] * 6, *(list(rng.choice(chosen, 6)) for _ in range(40))]
    return (
        (str(p), max((abs(a - b) for a, b in zip(corrected(p), closed(p), strict=True)), default=0.0)) for p in lists
    )


def _any_size() -> Seen:
    values = np.array([1.0, 4.0, 2.5, 3.5, 9.0, 2.0])
    one = np.array(mean_interval(values))
    for size in (1e-150, 1e-100, 1e-60, 1e60, 1e100, 1e150):
        yield f"{size:g}", float(np.abs(np.array(mean_interval(size * values)) / size / one - 1).max() / EPS)
    for gone in (np.nan, np.inf):
        yield f"{gone}", 0.0 if mean_interval([*values[:4], gone]) is None else np.inf
