"""Scoring protocols (scoring_protocols.toml): which pixels of a depth map are scored, against which
reference, and by which figures.

Every result records the name and version of its protocol. Figures of different protocols or
versions cannot be compared.
"""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from handbench.bench.evaluation.metrics import METRICS
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError

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
