"""Scoring protocols (scoring_protocols.toml): which pixels of a depth map are scored, against which
reference, and by which figures; and the main table of a result, which has these figures.

Every result records the name and version of its protocol. Figures of different protocols or
versions cannot be compared.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from handbench.bench.evaluation.combine import MethodScores
from handbench.bench.evaluation.metrics import METRICS
from handbench.bench.evaluation.tables import TABLE, frame
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

# surfaces to score against; completed: by the truth, where photogrammetry has no surface
REFERENCES = ("photogrammetry", "completed", "truth")


@dataclass(frozen=True)
class Protocol:
    """A way of scoring a benchmark: which pixels count, against which reference, by which metrics.
    metrics: those in the table; compared: those by which methods are compared; rules: the rules in
    words; setting: with what the protocol's authors measured; masks: whether the data set's own
    mask is applied; erodes: whether pixels at the edges of the target are left out; frame: the
    frame that is scored."""

    id: str
    version: int
    source: str
    metrics: tuple[str, ...]
    compared: tuple[str, ...]
    rules: dict[str, str]
    setting: dict[str, Any] = field(default_factory=dict)
    masks: bool = False
    erodes: bool = False
    frame: int = 0

    def about(self) -> dict[str, Any]:
        """Return the protocol as the entry "protocol" of result.json."""
        facts = {name: getattr(self, name) for name in ("id", "version", "source", "frame")}
        figures = {"metrics": list(self.metrics), "compared": list(self.compared)}
        return {**facts, **self.rules, **figures, "setting": self.setting}


def _protocols() -> dict[str, Protocol]:
    """Read the protocols of scoring_protocols.toml: id → Protocol."""
    known = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
    found = {}
    for name, own in known.items():
        base = known.get(own.pop("like", ""), {})
        facts = {**base, **own, "rules": base.get("rules", {}) | own["rules"]}
        without = facts.pop("without", ())
        metrics = facts.pop("metrics", [key for key in METRICS if key not in without])
        found[name] = Protocol(
            name, metrics=tuple(metrics), compared=tuple(facts.pop("compared")), **facts
        )
    return found


PROTOCOLS = _protocols()
PAPER = PROTOCOLS["paper"]


def protocol(name: str) -> Protocol:
    """Return the protocol with this id. Raises HandbenchError for an unknown one."""
    if name not in PROTOCOLS:
        raise HandbenchError(f"protocol: unknown '{name}'; {suggest(name, list(PROTOCOLS))}")
    return PROTOCOLS[name]


def main_table(
    scores: pd.DataFrame, protocol: Protocol, seed: int, with_paper: bool
) -> pd.DataFrame:
    """Compute the main table (TABLE) from the table of scores (SCORES): the figures of each method,
    for one reference after the other.
    scores: only the captures and methods of the table, in their order. protocol: which metrics are
    shown. seed: of bootstrap intervals. with_paper: False leaves the column `paper` empty."""
    rows: list[tuple[object, ...]] = []
    own = scores[scores.treatment == ""]
    for reference in REFERENCES:
        lines = own[own.reference.isin((reference, ""))]
        captures: dict[Any, np.ndarray] = lines.groupby("metric").capture.unique().to_dict()
        for method in lines.method[lines.reference == reference].unique():
            of_method: dict[Any, pd.DataFrame] = dict(
                iter(lines[lines.method == method].groupby("metric"))
            )
            method_scores = MethodScores(of_method, captures, seed)
            for metric in (m for m in METRICS.values() if m.key in protocol.metrics):
                figure = metric.combine(metric, method_scores)
                if figure is not None:
                    value, interval = figure
                    paper = metric.paper.get(method) if with_paper else None
                    ends = interval or (None, None)
                    rows.append((metric.key, method, value, *ends, metric.unit, paper, reference))
    return frame(TABLE, rows)
