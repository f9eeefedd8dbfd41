"""Protocols: what of a depth map is scored, against what, and which figures enter the table.

A protocol is named and versioned in every result. Figures of two protocols, or of two versions, do not compare.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from bench.evaluation.metrics import HEADLINE, METRICS
from radar.support.config import suggest
from radar.support.errors import HandbenchError


@dataclass(frozen=True)
class Protocol:
    """How a benchmark is scored. metrics: those of the table; compared: those by which methods are compared; frame: the
    one that is scored; masks: whether the data set's own mask is applied, erodes: with the target's edges taken away;
    rules: in words; setting: what its authors measured with, to compare a benchmark's own configuration with."""

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
        """What result.json says of it under "protocol"."""
        return {
            "id": self.id,
            "version": self.version,
            "source": self.source,
            "frame": self.frame,
            **self.rules,
            "metrics": list(self.metrics),
            "compared": list(self.compared),
            "setting": self.setting,
        }


REFERENCE = (
    "first surface along +z from the array's plane; the transform radar_from_photo is estimated once, on the "
    "calibration target, and never refitted; invented surface is never scored"
)
DISTANCES = ("chamfer_to_reference_mm", "chamfer_to_map_mm", "chamfer_mm")

PAPER = Protocol(
    id="paper",
    version=2,
    source="J. Bräunig, V. Wirth, M. Stamminger, I. Ullmann, M. Vossiek: the 3-FSK paper, Table I and its text",
    metrics=tuple(key for key in METRICS if key != "deviation_mm"),
    compared=(HEADLINE, "completeness_percent"),
    rules={
        "accuracy": "frame 0 of every capture; errors along z on the method's pixels where map and reference exist, "
        "pooled over the captures",
        "precision": "standard deviation over the repeats of the z of the strongest scatterer, averaged over the "
        "captures; the scatterer is the pixel with the largest mean amplitude of those observed in every repeat",
        "mask": "none: every pixel above the method's threshold counts",
        "reference": REFERENCE,
    },
    setting={
        "poses": ["B", "F", "U"],
        "precision_hands": 3,
        "repeats": 10,
        "grid_m": {"x": [-0.15, 0.15], "y": [-0.15, 0.15], "step": 1e-3},
        "z_m": [0.245, 0.325, 1e-3],
        "threshold_db": {"fsk": -10.0, "volume": -13.0},
    },
)

MAROON = Protocol(
    id="maroon",
    version=1,
    source="V. Wirth et al.: MAROON, public code (code/main.py, utils/metrics.py, utils/visualization_utils.py)",
    metrics=(HEADLINE, "floor_mm", "max_mm", "bias_mm", "deviation_mm", *DISTANCES, "n_observed", "seconds"),
    compared=(HEADLINE, "chamfer_to_reference_mm"),
    rules={
        "accuracy": "frame 0; signed projective error z − z_ref at every scored pixel with a reference (mean: bias; "
        f"mean and deviation of its absolute value: {METRICS[HEADLINE].title} and deviation of AE)",
        "chamfer": "mean distance of the map's points to the reference's points (one-sided), back, and the mean of "
        "both; theirs goes to all points of the photogrammetric mesh, ours to its depths on the map's grid",
        "mask": "pixels on target inside the data set's mask_bb; mask_erosion is not applied, as in the "
        "configuration that their code ships with",
        "reference": REFERENCE,
    },
    setting={"threshold_db": {"volume": -14.0}, "z_m": [0.25, 0.4], "distances_m": [0.3, 0.4, 0.5]},
    masks=True,
)

MAROON_ERODED = replace(
    MAROON,
    id="maroon-eroded",
    rules={
        **MAROON.rules,
        "mask": "pixels on target inside the data set's mask_bb, the target eroded by a square of mask_erosion/4 "
        "pixels (metadata.json), or the largest smaller one that leaves more than 10; 0 erodes nothing",
    },
    erodes=True,
)

PROTOCOLS = {protocol.id: protocol for protocol in (PAPER, MAROON, MAROON_ERODED)}


def protocol(name: str) -> Protocol:
    """The protocol of this name; an unknown one is a HandbenchError."""
    if name not in PROTOCOLS:
        raise HandbenchError(f"protocol: unknown '{name}'; {suggest(name, list(PROTOCOLS))}")
    return PROTOCOLS[name]
