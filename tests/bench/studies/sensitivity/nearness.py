"""The distance of a table's figures to the paper's, and what the settings of a joint design say
about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.stats import kruskal

from handbench.bench.evaluation.metrics import HEADLINE, METRICS
from tests.bench.studies.columns import Record
from tests.bench.studies.sensitivity.sensitivity_cases import Value, ranged, shown, titled
from tests.bench.studies.sensitivity.sensitivity_factors import SIMULATED, FactorsFile

KEYS = (HEADLINE, "max_mm", "precision_mm")
PAPER = {
    f"{family}_{key}": value for key in KEYS for family, value in METRICS[key].paper.items()
}  # the ten figures
BROADBAND, FSK = f"broadband_{HEADLINE}", f"3fsk_{HEADLINE}"
THIRDS = ("low", "middle", "high")
SIGNIFICANT = 0.05  # of all factors together: each is held to its share
POSSIBILITY = (
    "The nearest of {count} settings of {factors} free factors is a possibility and no finding: "
    "among so many some "
    "come near by themselves, and others that are as near may say the opposite."
)


def distance(figures: Mapping[str, float | None]) -> float:
    """Root mean square of ln(ours / the paper's) over its figures among these; NaN where one is not
    known or there is none: 0.1 is 10 % off on average."""
    logs = [
        np.log(value / PAPER[name]) if value else np.nan
        for name, value in figures.items()
        if name in PAPER
    ]
    return float(np.sqrt(np.mean(np.square(logs)))) if logs else np.nan


def agreeing(figures: Mapping[str, float | None], within_percent: float) -> int:
    """The number of the paper's figures from which these are at most so far off."""
    known = [
        (value, PAPER[name])
        for name, value in figures.items()
        if name in PAPER and value is not None
    ]
    return sum(abs(value / paper - 1) <= within_percent / 100 for value, paper in known)


def factor_records(
    settings: pd.DataFrame, factors: Mapping[str, Sequence[Value]], near: pd.DataFrame
) -> list[Record]:
    """Of each factor the mean distance in the thirds of its range (of its values, if it has no
    range), the probability of such differences if it did not matter, and where the near settings
    lie; what matters most comes first.

    Settings that share a simulated placement are one for the factors of the simulation
    (Kruskal–Wallis).
    """
    records = []
    for name, values in factors.items():
        if len(set(settings[name])) < 2:
            continue
        part = settings.assign(part=third(settings[name], values))
        means = part.groupby("part").distance.mean()
        apart = part.groupby("placement")[["part", "distance"]].agg(
            {"part": "first", "distance": "mean"}
        )
        units = apart if name in SIMULATED else part
        groups = [group.distance.to_numpy() for _, group in units.groupby("part")]
        p = (
            float(kruskal(*groups).pvalue)
            if len(groups) > 1 and np.ptp(np.concatenate(groups)) > 0
            else 1.0
        )
        shown_means = ", ".join(f"{name}: {mean:.2f}" for name, mean in means.items())
        records.append(
            {
                "factor": name,
                "p": p,
                "means": shown_means,
                "near": _span(name, near[name]),
                "units": len(units),
            }
        )
    return sorted(records, key=lambda record: record["p"])


def third(found: pd.Series, values: Sequence[Value]) -> pd.Series:
    """The part of a factor's range that each setting lies in: a third, or the value where there is
    no range."""
    if not ranged(values):
        return found.astype(str)
    numbers = np.array(values, float)
    share = (found.astype(float) - numbers.min()) / np.ptp(numbers)
    return pd.Series([THIRDS[min(int(3 * s), 2)] for s in share], index=found.index)


def _span(name: str, found: pd.Series) -> str:
    """The middle eight tenths of the near settings, or how often each value is among them."""
    if found.dtype.kind == "f":
        return " to ".join(shown(name, float(value)) for value in np.quantile(found, (0.1, 0.9)))
    values, counts = np.unique(found.to_numpy(), return_counts=True)
    return ", ".join(
        f"{shown(name, value)}: {count}"
        for value, count in zip(values.tolist(), counts, strict=True)
    )


def answer(
    settings: pd.DataFrame,
    tried: int,
    factors: list[Record],
    turned: list[Record],
    file: FactorsFile,
) -> str:
    """The answer in words. tried: how many settings there were, with those that failed; factors,
    turned: of `factor_records`, for the distance and for the order of broadband and 3-FSK."""
    first = settings.iloc[0]
    limit = SIGNIFICANT / max(len(factors), 1)
    tied = [f"{titled(r['factor'])} ({r['near']})" for r in factors if r["p"] < limit]
    free = [titled(r["factor"]) for r in factors if r["p"] >= limit]
    order = [f"{titled(r['factor'])} ({r['near']})" for r in turned if r["p"] < limit]
    failed = tried - len(settings)
    below = int(settings.turned.sum())
    parts = [
        f"{tried} settings were tried" + (f", {failed} of which failed" if failed else "") + ".",
        f"The nearest, {first['name']}, is {first.distance:.2f} from the paper (root mean square "
        "of ln(ours / paper)) "
        f"and has {first.agree} of {len(PAPER)} figures within {file.within_percent:g} % of it; "
        "half of the settings "
        f"are within {settings.distance.median():.2f}.",
        _listed("Being near ties down", tied, "no factor that these settings could tell")
        + ", by the mean distance over "
        f"the parts of each factor's range (p < {SIGNIFICANT:g} for all {len(factors)} factors "
        "together; in brackets: "
        f"where the nearest {file.near_percent:g} % lie).",
        _listed("Not shown to matter for the distance", free, "none") + ".",
        f"Broadband has a lower mean absolute error than 3-FSK in {below} of {len(settings)} "
        "settings"
        + (
            _listed("; what these have in common", order, "no single factor") + "."
            if below
            else "."
        ),
        POSSIBILITY.format(count=tried, factors=len(factors)),
    ]
    return "\n".join(f"- {part}" for part in parts) + "\n"


def _listed(what: str, names: list[str], none: str) -> str:
    return f"{what}: {', '.join(names) or none}"
