"""Hard cases of the figures: small spreads about large depths, 10⁸ samples, one repeat, equal values, NaN, nothing.

What intervals and tests make of the figures is in `statistics_intervals`.
"""

import tracemalloc
from collections.abc import Iterable
from itertools import product

import numpy as np
import pandas as pd

from bench.evaluation.depth_errors import deviation_map, error_map
from bench.evaluation.floor import floor_mm
from bench.evaluation.metrics import AVERAGED, HEADLINE, averaged, of_captures, pool, precision, strongest_scatterer_z_m
from bench.evaluation.statistics.intervals import figure_interval, median_interval, precision_interval
from bench.evaluation.statistics.paired import compare, f_test
from bench.results.error_map import ErrorMap
from bench.results.result_folder import shown
from bench.results.tables import each
from bench.studies.stability.cases import Seen
from bench.studies.stability.statistics_intervals import DEPTH_M, EPS, PIXEL_M, a_map, told
from groundtruth.mesh.depth import Reference

SIDE = 300
COUNTED = ("n_observed", "observed_percent", "false_alarm_percent")  # shares of nothing observed that are known
BOUNDS = {
    "pooled_deviation": 1.5 * (np.log2(SIDE**2) + 1),
    "many_samples": 1.5 * (np.log2(SIDE**2) + 1) + 1112 / 2,
    "all_equal": EPS,
    "not_finite": 1.5 * (np.log2(SIDE**2) + 1),
}


def _precision_about_depth() -> Seen:
    for spread_m, n in product((1e-3, 1e-6, 1e-9, 1e-12, 0.0), (2, 10, 100_000)):
        z_m = DEPTH_M + spread_m * np.where(np.arange(n) % 2, 1.0, -1.0)
        off_m = abs(1e-3 * told(precision([z_m])["precision_mm"]) - spread_m * np.sqrt(n / (n - 1)))
        yield f"{1e6 * spread_m:g} µm, {n} repeats", off_m / (EPS * DEPTH_M)


def _deviation_of_float32() -> Seen:
    for n, spread_m in product((2, 3, 100, 10_000), (1e-3, 1e-6, 1e-7)):
        noise = np.random.default_rng(n).standard_normal((n, 4, 4))
        z_m = (DEPTH_M + spread_m * noise).astype(np.float32)
        wide = np.std(z_m.astype(np.longdouble), axis=0, ddof=1)
        found = deviation_map(np.arange(4), np.arange(4), z_m).error_m
        known = wide > 0  # two float32 depths may be equal
        off = np.abs(found / np.where(known, wide, 1) - known).max()
        yield f"{1e6 * spread_m:g} µm, {n} repeats", float(off / EPS)


def _pooled_deviation() -> Seen:
    noise = np.random.default_rng(0).standard_normal((SIDE, SIDE))
    for spread_m in (1e-3, 1e-5, 1e-6, 1e-7, 1e-8, 0.0):
        error_m = DEPTH_M + spread_m * noise
        wide_m2 = np.var(error_m.astype(np.longdouble))
        off_m2 = abs((1e-3 * told(pool([a_map(error_m)])["deviation_mm"])) ** 2 - wide_m2)
        yield f"{1e6 * spread_m:g} µm", float(off_m2 / (EPS * DEPTH_M**2))


def _many_samples() -> Seen:
    error_m = 1e-3 + 1e-6 * np.random.default_rng(0).standard_normal((SIDE, SIDE))
    one = of_captures([a_map(error_m)])
    found = averaged(pd.concat([one] * 1112))  # 90 000 pixels each: 10⁸
    wide = error_m.astype(np.longdouble)
    wanted = {"mae_mm": np.abs(wide).mean(), "rmse_mm": np.sqrt((wide**2).mean()), "bias_mm": wide.mean()}
    wanted["pooled_mae_mm"] = wanted["mae_mm"]
    return ((key, float(abs(told(found[key]) / (1e3 * value) - 1)) / EPS) for key, value in wanted.items())


def _memory() -> float:
    def peak(maps: int) -> int:
        m = a_map(np.full((200, 200), 1e-3))
        tracemalloc.start()
        of_captures(a_map(m.error_m.copy()) for _ in range(maps))
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    peak(1)  # what the first call keeps
    return peak(40) / peak(4)


def _one_repeat() -> float:
    one, two = np.array([0.3]), np.array([0.3, 0.301])
    gap = np.array([0.3, np.nan, np.inf])  # one that is seen
    given = [
        *(precision(hands)["precision_mm"] for hands in ([one], [two, one], [gap], [])),
        precision_interval([one]),
        precision_interval([two, gap]),
        *(None if np.isnan(f) else f for f in (f_test([one], [two]).p, f_test([two], [gap]).difference)),
        median_interval(two),
        pool([deviation_map(np.arange(2), np.arange(2), np.full((1, 2, 2), 0.3))])["median_mm"],
    ]
    return float(sum(value is not None for value in given))


def _all_equal() -> Seen:
    for z_m in (0.1, 0.3, 0.7, 1 / 3):
        hands = [np.full(n, z_m) for n in (2, 3, 7)]
        yield f"precision at {z_m:g} m", told(precision(hands)["precision_mm"])
        yield f"its interval at {z_m:g} m", max(precision_interval(hands) or [np.nan])
        yield f"two methods at {z_m:g} m", 1 - told(f_test(hands, [np.full(3, 0.7 * z_m)]).p)
        repeats = deviation_map(np.arange(2), np.arange(2), np.full((3, 2, 2), z_m))
        yield f"map at {z_m:g} m", 1e-3 * told(pool([repeats])["max_mm"])
    low, high = median_interval(np.full(5, 0.3)) or (np.nan, np.nan)
    yield "median", high - low
    maps = [a_map(np.full((60, 60), 1e-3))]
    figures = of_captures(maps * 5).mae_mm.to_numpy()
    [line] = each(compare({"a": figures, "b": figures}, ""))
    yield "two equal methods", 1 - line.p_corrected


def _rounding_alone() -> Seen:
    x_m = 2.5e-3 * np.arange(36)
    slope_m = DEPTH_M + 0.1 * x_m[:, None] + 0 * x_m
    for captures, error_m in product((1, 5, 8), np.linspace(1e-4, 5e-3, 12)):
        a, b = (of_captures([error_map(x_m, x_m, slope_m + s * error_m, slope_m)] * captures) for s in (1, -1))
        lines = [compare({"a": a[key].to_numpy(), "b": b[key].to_numpy()}, "", key) for key in (HEADLINE, "rmse_mm")]
        yield f"{captures} captures, {1e3 * error_m:.3g} mm", sum(shown(line).sum() for line in lines)


def _not_finite() -> Seen:
    rng = np.random.default_rng(0)
    for broken in (np.nan, np.inf, -np.inf):
        for share in (0.01, 0.5, 0.999):
            z_m, z_ref_m = DEPTH_M + 1e-3 * rng.standard_normal((SIDE, SIDE)), np.full((SIDE, SIDE), DEPTH_M)
            z_m[rng.random(z_m.shape) < share] = broken
            z_ref_m[rng.random(z_m.shape) < share / 2] = broken
            error = (z_m - DEPTH_M)[np.isfinite(z_m) & np.isfinite(z_ref_m)].astype(np.longdouble)
            x_m = PIXEL_M * np.arange(SIDE)
            found = pool([error_map(x_m, x_m, z_m, z_ref_m)])
            wanted = {"mae_mm": np.abs(error).mean(), "rmse_mm": np.sqrt((error**2).mean())}
            wanted["median_mm"] = np.median(np.abs(error).astype(float))
            for key, value in wanted.items():
                yield f"{share:.1%} {broken}, {key}", float(abs(told(found[key]) / (1e3 * value) - 1) / EPS)
        mixed = np.array([0.3, broken, 0.301, broken, 0.303])
        off = told(precision([mixed])["precision_mm"]) / told(precision([mixed[::2]])["precision_mm"]) - 1
        yield f"precision with {broken}", abs(off) / EPS
        amplitude = np.array([[[1.0, broken, 2.0]]] * 2)
        strongest = strongest_scatterer_z_m(np.array([[[0.3, 0.4, 0.5]]] * 2), amplitude)
        yield f"strongest with {broken}", 0.0 if strongest[0] == (0.4 if broken == np.inf else 0.5) else np.inf


def _empty() -> Seen:
    x_m, surface = PIXEL_M * np.arange(40), np.full((40, 40), DEPTH_M)
    unobserved = error_map(x_m, x_m, np.full((40, 40), np.inf), surface, met=np.ones((40, 40), bool))
    nothing = [
        ("no map", []),
        ("no pixel", [a_map(np.empty((0, 0)))]),
        ("no row", [a_map(np.empty((0, 5)))]),
        ("all NaN", [a_map(np.full((40, 40), np.nan))] * 3),
        ("all unobserved", [unobserved] * 6),
    ]

    def given(maps: list[ErrorMap]) -> Iterable[object]:
        # Of a surface that nobody observed the completeness is 0, and the F-score.
        shares = {k for k, v in pool(maps).items() if v == 0 and k.startswith(("f_", "complete_"))}
        values = {k: v for k, v in pool(maps).items() if k not in (*COUNTED, *shares)}
        yield from (value for value in values.values() if value is not None)
        figures = of_captures(maps)
        yield from (key for key in AVERAGED if key not in COUNTED and figure_interval(key, figures[key].to_numpy()))
        yield from each(compare({"a": figures.mae_mm.to_numpy(), "b": figures.mae_mm.to_numpy()}, ""))
        if floor_mm(maps, [_known(m) for m in maps]) is not None:
            yield "floor"

    return ((name, float(len(list(given(maps))))) for name, maps in nothing)


def _known(m: ErrorMap, sigma_m: float = 1e-3) -> Reference:
    """A reference with one σ for all of a map's pixels, from its mesh alone."""
    from calibration.transforms import Transform

    shape = m.error_m.shape
    registration = Transform("photo", "radar", np.eye(4), covariance=np.zeros((6, 6)))
    return Reference(m.reference_z_m, np.full(shape, sigma_m), np.zeros((*shape, 6)), registration)


def _one_pixel() -> Seen:
    for error_m in (1e-12, -1e-6, 1e-3, -0.3, 1e6):
        m = a_map(np.array([[error_m]]))
        found = pool([m])
        for key in ("mae_mm", "rmse_mm", "median_mm", "p95_mm", "max_mm"):
            yield f"{key} of {error_m:g} m", abs(told(found[key]) / (1e3 * abs(error_m)) - 1) / EPS
        alone = figure_interval(HEADLINE, of_captures([m]).mae_mm.to_numpy())
        yield f"interval of {error_m:g} m", np.inf if alone else told(found["deviation_mm"])
        floor = told(floor_mm([m], [_known(m, abs(error_m))])) / (1e3 * np.sqrt(2 / np.pi) * abs(error_m))
        yield f"floor for σ = {abs(error_m):g} m", abs(floor - 1) / EPS
        for sigma_m in (np.nan, np.inf):
            yield f"floor for σ = {sigma_m}", 0.0 if floor_mm([m], [_known(m, sigma_m)]) is None else np.inf
