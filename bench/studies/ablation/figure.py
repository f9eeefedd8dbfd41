"""The effects as a figure: what each changes, measured and estimated, and what it costs."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bench.studies.study import BLUE, GREY, VERMILION

SMALLEST_MM = 1e-4  # what is smaller stands at the axis


def draw(frames: dict[str, pd.DataFrame]) -> Figure:
    """Left: the change of the depth map; right: seconds."""
    rows = frames["rows"]
    effects = rows[rows.case != "reference"].sort_values("change_mm", kind="stable")
    figure = Figure(figsize=(9.5, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2), sharey=True)
    places = np.arange(len(effects))
    measured, estimated = (effects[key].astype(float).clip(SMALLEST_MM) for key in ("change_mm", "estimate_mm"))
    left.barh(places, measured, color=BLUE, height=0.6, label="measured, mean |Δz| of the 3-FSK map")
    left.plot(estimated, places, "D", color=VERMILION, label="estimated")
    left.axvline(0.1, color=GREY, linestyle="--", linewidth=0.8)
    left.annotate("0.1 mm", (0.1, len(effects) - 0.4), color=GREY, ha="center", va="bottom", annotation_clip=False)
    left.set_yticks(places, effects.case)
    left.set(xscale="log", xlabel="change of the depth map, mm", xlim=(SMALLEST_MM, 20))
    right.barh(places, effects.simulate_s, color="0.85", label="whole simulation")
    right.barh(places, effects.effect_s, color=BLUE, label="the effect")
    right.set(xlabel="seconds per pose, 130 tones", title="what it costs")
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return figure
