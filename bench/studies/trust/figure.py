"""Reliability of p_gross, and the risk that is left where the least trusted pixels are dropped; a curve each method."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from bench.studies.trust.fit import DROPPED_PERCENT

LEAST = 1e-4  # of p_gross, and of shares, that are shown
GROUPS = ("calibration", "other surfaces", "hands", "assorted", "captures")


def draw(frames: dict[str, pd.DataFrame]) -> Figure:
    """A column each group of scenes; above reliability, below risk and coverage."""
    rows, bins = frames["rows"], frames["reliability"]
    groups = [name for name in GROUPS if name in set(rows.group)]
    figure = Figure(figsize=(2.6 * len(groups) + 1.2, 5.4), layout="constrained")
    for (above, below), name in zip(figure.subplots(2, len(groups), squeeze=False).T, groups, strict=True):
        above.plot([LEAST, 1], [LEAST, 1], color="0.7", linewidth=0.8)
        for method, told in bins[bins.group == name].groupby("method", sort=False):
            above.plot(told.p_gross.clip(LEAST), told.wrong.clip(LEAST), marker=".", linewidth=0.9, label=method)
        for _, row in rows[rows.group == name].iterrows():
            left = [max(row[f"left_{d}_percent"], 100 * LEAST) for d in DROPPED_PERCENT]
            below.plot(DROPPED_PERCENT, left, marker=".", linewidth=0.9, label=row["method"])
        above.set(title=name, xscale="log", yscale="log", xlabel="p_gross", ylabel="share wrong")
        below.set(yscale="log", xlabel="least trusted dropped, %", ylabel="wrong among the rest, %")
    below.legend(fontsize=6)
    return figure
