"""Tables that are computed from the scores, error maps and depth maps of a result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.combine import STRONGEST
from handbench.bench.evaluation.depth_errors import coverage_percent
from handbench.bench.evaluation.metrics import HEADLINE, METRICS, TREATMENTS
from handbench.bench.evaluation.paired import FEWEST_PERCENT, compare
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.bench.evaluation.tables import COMPARISONS, conform, frame
from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.maps import depth_path
from handbench.radar.data.depthmap import load_depthmap
from handbench.support.errors import HandbenchError

if TYPE_CHECKING:
    from handbench.bench.results.result_folder import Result

MOST_SURFACE = ("completed", *(name for name in REFERENCES if name != "completed"))
# of moving scenes in the table of scores: mean |radial velocity| of the surface, mm/s; time from
# one tone to the next, s; start of a frame, s
SPEED, STEP, START = "speed_mm_s", "step_time_s", "start_s"


def repeats(scores: pd.DataFrame) -> pd.DataFrame:
    """Return the depth of the strongest scatterer in every repeated frame: capture, method, repeat,
    z_m."""
    lines = scores[scores.metric == STRONGEST].rename(columns={"frame": "repeat", "value": "z_m"})
    return lines[["capture", "method", "repeat", "z_m"]].reset_index(drop=True)


def compared_metrics(protocol: Mapping[str, Any]) -> list[str]:
    """Return the metrics by which methods are compared with their own settings, not under equal
    treatment.
    protocol: the entry "protocol" of result.json."""
    named = protocol.get("compared")
    if not isinstance(named, list | tuple):
        return []
    return [key for key, m in METRICS.items() if key in named and m.of and m.better != "zero"]


def fullest_reference(captures: Sequence[CaptureFacts]) -> str:
    """Return the reference that covers the most surface among those that all captures have; ""
    without one."""
    return next((name for name in MOST_SURFACE if all(name in c.references for c in captures)), "")


def treated_scores(scores: pd.DataFrame, captures: Sequence[CaptureFacts]) -> pd.DataFrame:
    """Select the scores under equal treatment (same smoothing for all methods), against the fullest
    reference.
    Only methods that have every treatment on every capture are included; with fewer than two such
    methods there is no line."""
    of_reference = scores.reference == fullest_reference(captures)
    lines = scores[of_reference & (scores.treatment != "")]
    counts = lines[["capture", "treatment", "method"]].drop_duplicates().method.value_counts()
    everywhere = counts.index[counts == len(captures) * len(TREATMENTS)]
    return lines[lines.method.isin(everywhere if len(everywhere) > 1 else ())]


def by_method(lines: pd.DataFrame) -> dict[str, np.ndarray]:
    """Arrange the scores by one metric, against one reference, under one treatment: method → figure
    of the first frame on each capture [n], NaN where there is none.
    Methods and captures keep the order of the scores."""
    first = lines[lines.frame == 0]
    wide = first.pivot(index="capture", columns="method", values="value")
    wide = wide.reindex(first.capture.unique(), columns=first.method.unique())
    return {str(method): of.to_numpy() for method, of in wide.items()}


def few_pixels(scores: pd.DataFrame, captures: Sequence[CaptureFacts]) -> str:
    """Return a note for readers on the methods that observe less than 1 % of a capture's surface
    (FEWEST_PERCENT) and are therefore not compared under equal treatment; "" for none."""
    own = scores[(scores.reference == fullest_reference(captures)) & (scores.treatment == "")]
    few = own.method[(own.metric == "observed_percent") & (own.value < FEWEST_PERCENT)]
    taking_part = set(treated_scores(scores, captures).method)
    names = ", ".join(method for method in few.unique() if method not in taking_part)
    share = f"fewer than {FEWEST_PERCENT:g} % of the surface of a capture"
    return f"not compared on common pixels: {names} ({share})" if names else ""


def motion(scores: pd.DataFrame) -> pd.DataFrame:
    """Arrange the figures of every method on every capture whose true velocity is known: capture,
    method, SPEED, STEP, and a column for each metric. Empty if no capture moves."""
    lines = scores[(scores.reference == "truth") & (scores.frame == 0) & (scores.treatment == "")]
    table = lines.pivot(index=["method", "capture"], columns="metric", values="value").reset_index()
    for name in (SPEED, STEP):
        known = lines[lines.metric == name].drop_duplicates("capture").set_index("capture").value
        table[name] = table.capture.map(known)
    return table[table[SPEED].notna()] if table[SPEED].any() else table[:0]


def equal(scores: pd.DataFrame, captures: Sequence[CaptureFacts]) -> pd.DataFrame:
    """Average the figures of all methods under equal treatment (same smoothing) over the captures:
    metric, treatment, method, value, low, high (95 % interval), unit, reference."""
    columns = ["metric", "treatment", "method", "value", "low", "high", "unit", "reference"]
    reference, lines = fullest_reference(captures), treated_scores(scores, captures)
    groups = dict(iter(lines.groupby(columns[:3]).value))
    rows = [
        (*key, of.mean(), *(metric.interval(of) or (np.nan, np.nan)), metric.unit, reference)
        for treatment, method, metric in product(
            TREATMENTS, lines.method.unique(), METRICS.values()
        )
        if (of := groups.get(key := (metric.key, treatment, method))) is not None
    ]
    return pd.DataFrame(rows, columns=columns)


def comparisons(
    scores: pd.DataFrame,
    captures: Sequence[CaptureFacts],
    protocol: Mapping[str, Any],
    titles: Mapping[str, str],
) -> pd.DataFrame:
    """Test the difference of every pair of methods: the table COMPARISONS.
    With their own settings, methods are compared by the metrics that the protocol names, against
    each reference. Under equal treatment, they are compared against the reference that covers the
    most surface. titles: of the methods, by name."""
    treated = treated_scores(scores, captures)
    wanted = [
        *product([scores], REFERENCES, [""], compared_metrics(protocol)),
        *product([treated], [fullest_reference(captures)], TREATMENTS, [HEADLINE]),
    ]
    tables = [frame(COMPARISONS)]
    for lines, reference, treatment, metric in wanted:
        of_metric = lines[(lines.reference == reference) & (lines.metric == metric)]
        figures = by_method(of_metric[of_metric.treatment == treatment])
        tables.append(compare(figures, reference, metric, titles, treatment))
    return conform(pd.concat(tables), COMPARISONS)


def reliability(result: Result) -> pd.DataFrame:
    """Compute how often the intervals of a method's σ contain its errors, averaged over the
    captures: reference, method, nominal_percent, observed_percent.
    Raises HandbenchError if the maps of depths and of errors of a capture differ in size."""
    rows: list[tuple[str, str, int, float]] = []
    for capture, method in product(result.scored(), result.about.methods):
        file = depth_path(result.folder, capture.name, method.name)
        depth = load_depthmap(file)
        for reference in capture.references:
            errors = result.errors(capture.name, method.name, reference)
            if errors.error_m.shape != depth.z_m.shape:
                raise HandbenchError(
                    f"{file}: has {depth.z_m.shape} pixels [ny, nx], but its errors in errors/ "
                    f"have {errors.error_m.shape}; run the benchmark again"
                )
            covered = coverage_percent(depth, errors)
            rows += [(reference, method.name, *shares) for shares in covered.items()]
    keys = ["reference", "method", "nominal_percent"]
    table = pd.DataFrame(rows, columns=[*keys, "observed_percent"])
    return table.groupby(keys, sort=False).mean().reset_index()
