"""Accuracy against time: the methods that no other beats (the front), and the choice of one.

No method on the front has another that is at least as fast, as accurate and as complete, and better
in one of these. A map is as complete as it is right within 2 mm: one that shows twice as much of a
hand is not beaten by a more accurate map of half of it, unless what it shows is wrong. One that is
right nowhere is beaten by any that is right somewhere.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.metrics import HEADLINE, METRICS
from handbench.support.errors import HandbenchError

SURFACE = "surface_rms_mm"  # the error of reconstructed surfaces, of the ground truth's sweep
SHARE = {HEADLINE: "complete_2mm_percent", SURFACE: "observed_percent"}  # that counts as complete
HEADROOM = 1.1  # of a later run over the upper end of the time's interval
LIMITED = ["value", "low", "high"]


def fronts(
    table: pd.DataFrame, scores: pd.DataFrame, ids: Mapping[str, str]
) -> dict[str, pd.DataFrame]:
    """Return the ranked methods (see `ranked`) for each error: of depth maps, from the table of a
    result, against the true surface where it is known; of reconstructed surfaces, from the scores.
    ids: name → id of the methods. An error without figures is left out."""
    names = scores.method[scores.metric == SURFACE].unique()
    lines = {
        HEADLINE: table[table.reference.isin(table.reference.tail(1))],
        SURFACE: scores[scores.method.isin(names)],
    }
    found = {error: figures(some, error) for error, some in lines.items()}
    return {error: ranked(some, ids) for error, some in found.items() if len(some)}


def figures(lines: pd.DataFrame, error: str = HEADLINE) -> pd.DataFrame:
    """Arrange the figures of methods as one line for each, in their order: seconds, seconds_low,
    seconds_high, error, low, high (95 % intervals) and share_percent (SHARE), NaN where unknown;
    and the reference of the error.
    lines: method, reference, metric, value and, if known, low and high; error: the metric. Methods
    without error or time are left out."""
    columns = {"seconds": "seconds", error: "error", SHARE[error]: "share_percent"}
    wide: dict[str, pd.Series] = {}
    for metric, column in columns.items():
        known = lines[lines.metric == metric].drop_duplicates("method").set_index("method")
        known = known.reindex(columns=LIMITED).astype(float)
        prefix = "" if metric == error else f"{column}_"
        wide |= {column: known.value, f"{prefix}low": known.low, f"{prefix}high": known.high}
    found = pd.DataFrame(wide).reindex(lines.method.unique())
    reference = next(iter(lines.reference[lines.metric == error]), "")
    return found.assign(reference=reference).dropna(subset=["seconds", "error"])


def ranked(settings: pd.DataFrame, ids: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Add to the figures of methods their rank: on_front; on_own_front, among the methods of the
    same id; dominated_by, the most accurate method on the front that beats it ("" on the front).
    ids: name → id; a name that is missing is its own id."""
    error, share_percent = settings.error.round(3), settings.share_percent.fillna(0.0).round(1)
    costs: Any = np.stack([settings.seconds, error, -share_percent], axis=1)  # as far as they count
    beats = (costs[:, None] <= costs).all(axis=-1) & (costs[:, None] < costs).any(axis=-1)
    beats |= (costs[:, None, 2] < 0) & (costs[:, 2] == 0)
    names = settings.index.to_numpy()
    own = np.array([(ids or {}).get(name, name) for name in names])
    on_front = ~beats.any(axis=0)
    best = np.where(beats & on_front[:, None], costs[:, 1:2], np.inf).argmin(axis=0)
    return settings.assign(
        on_front=on_front,
        on_own_front=~(beats & (own[:, None] == own)).any(axis=0),
        dominated_by=np.where(on_front, "", names[best]),
    )


def front(settings: pd.DataFrame) -> pd.DataFrame:
    """Return the ranked methods that no other beats, the fastest first."""
    return settings[settings.on_front].sort_values(["seconds", "error"])


def chosen(
    settings: pd.DataFrame, max_error_mm: float = math.inf, max_seconds: float = math.inf
) -> str:
    """Return the name of the cheapest method with at most this error and time; without a largest
    error, of the most accurate one.

    A method is judged by the upper ends of its intervals, and by a time a tenth longer, so that a
    later run stays within the limits. Raises HandbenchError, which names the nearest method, if
    there is none.
    """
    error_mm = settings.high.fillna(settings.error)
    seconds = HEADROOM * settings.seconds_high.fillna(settings.seconds)
    excess = pd.concat([error_mm / max_error_mm, seconds / max_seconds], axis=1).max(axis=1)
    fit = settings[excess <= 1]
    if fit.empty:
        name = str(excess.idxmin())
        raise HandbenchError(
            f"no method has {METRICS[HEADLINE].title} ≤ {max_error_mm:g} mm and time ≤ "
            f"{max_seconds:g} s; the nearest is '{name}' with up to {error_mm[name]:.3g} mm and "
            f"{seconds[name]:.3g} s; raise the limit, or measure more settings"
        )
    order = ["error", "seconds"] if math.isinf(max_error_mm) else ["seconds", "error"]
    return str(fit.sort_values(order).index[0])
