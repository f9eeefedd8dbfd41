"""The errors of the transforms as a figure, and whether their covariances told them."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import chi2

from bench.studies.study import BLUE


def draw(frames: dict[str, pd.DataFrame]) -> Figure | None:
    """Error, error in the hand's volume over its prediction, and the distribution of the normalised squared error, of
    the placements that were calibrated; None without one."""
    rows = frames["rows"].query("refused == ''")
    if rows.empty:
        return None
    figure = Figure(figsize=(9.5, 3.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    left.scatter(1e3 * rows.shift_m, np.degrees(rows.turn_rad), s=14, color=BLUE)
    left.set(xlabel="shift at the hand's centre in mm", ylabel="turn in °", xlim=0, ylim=0, title="error")
    middle.scatter(1e3 * rows.predicted_rms_m, 1e3 * rows.tre_rms_m, s=14, color=BLUE)
    end = 1.05e3 * rows[["tre_rms_m", "predicted_rms_m"]].to_numpy().max()
    middle.plot([0, end], [0, end], color="0.5", linewidth=0.8)
    middle.set(xlabel="predicted, RMS over the volume in mm", ylabel="seen in mm", xlim=(0, end), ylim=(0, end))
    middle.set_title("error in the hand's volume")
    nees = np.sort(rows.nees)
    x = np.linspace(0, max(20, nees[-1]), 200)
    right.plot(x, chi2.cdf(x, 6), color="0.5", linewidth=0.8, label="χ² of 6: honest")
    right.step(nees, (np.arange(len(nees)) + 0.5) / len(nees), where="mid", color=BLUE, label="seen")
    right.set(xlabel="normalised squared error", ylabel="share of the trials", title="honesty")
    right.legend(frameon=False, loc="lower right")
    return figure
