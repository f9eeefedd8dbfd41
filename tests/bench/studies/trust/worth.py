"""Logistic weights by maximum likelihood, and what a probability is worth: its reliability, the
risk that is left where the least trusted pixels are dropped, and a figure of both."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.optimize import minimize

# of a squared standardised weight: keeps features that say the same from large opposite weights
PENALTY = 1e-4
BINS = np.array([0, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0])
DROPPED_PERCENT = (0, 1, 2, 5, 10, 15, 20)
LEAST = 1e-4  # of p_gross, and of shares, that are shown


def fitted(found: np.ndarray, wrong: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Weights [1 + k], the constant first, that make wrong [n] likeliest given features [n, k];
    share [n]: of each pixel in the likelihood."""
    mean, scale = found.mean(axis=0), found.std(axis=0)
    scale = np.where(scale > 1e-6, scale, np.inf)  # what never changes gets no weight
    known = np.column_stack([np.ones(len(found)), (found - mean) / scale])
    sign, share = np.where(wrong, 1.0, -1.0), share / share.sum()

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        margin, penalised = sign * (known @ weights), np.r_[0.0, weights[1:]]
        slope = -share * sign / (1 + np.exp(np.clip(margin, -500, 500)))
        value = share @ np.logaddexp(0, -margin) + PENALTY * penalised @ penalised
        return float(value), slope @ known + 2 * PENALTY * penalised

    weights = minimize(
        loss, np.zeros(known.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": 500}
    ).x
    slopes = weights[1:] / scale
    return np.r_[weights[0] - slopes @ mean, slopes]


def silent_percent(p: np.ndarray, wrong: np.ndarray) -> list[float]:
    """Of the pixels that are left once the DROPPED_PERCENT with the largest p are dropped, the
    percentage wrong."""
    left = wrong[np.argsort(p, kind="stable")]
    return [
        100 * float(left[: max(1, round(len(left) * (1 - d / 100)))].mean())
        for d in DROPPED_PERCENT
    ]


def reliability(p: np.ndarray, wrong: np.ndarray) -> list[tuple[float, float, int]]:
    """Mean p, share wrong and number of the pixels in each of BINS that has any."""
    place = np.clip(np.searchsorted(BINS, p, side="right") - 1, 0, len(BINS) - 2)
    chosen = [place == i for i in range(len(BINS) - 1)]
    return [(float(p[c].mean()), float(wrong[c].mean()), int(c.sum())) for c in chosen if c.any()]


def draw(frames: dict[str, pd.DataFrame]) -> Figure:
    """A column each group of scenes; above reliability, below risk and coverage; a curve each
    method."""
    groups = list(dict.fromkeys(frames["rows"].group))
    figure = Figure(figsize=(2.6 * len(groups) + 1.2, 5.4), layout="constrained")
    for (above, below), name in zip(
        figure.subplots(2, len(groups), squeeze=False).T, groups, strict=True
    ):
        rows, bins = (
            frames[table][frames[table].group == name] for table in ("rows", "reliability")
        )
        above.plot([LEAST, 1], [LEAST, 1], color="0.7", linewidth=0.8)
        for method, told in bins.groupby("method", sort=False):
            above.plot(told.p_gross.clip(LEAST), told.wrong.clip(LEAST), marker=".", linewidth=0.9)
            left = rows[rows["method"] == method][
                [f"left_{d}_percent" for d in DROPPED_PERCENT]
            ].iloc[0]
            below.plot(
                DROPPED_PERCENT, left.clip(100 * LEAST), marker=".", linewidth=0.9, label=method
            )
        above.set(title=name, xscale="log", yscale="log", xlabel="p_gross", ylabel="share wrong")
        below.set(yscale="log", xlabel="least trusted dropped, %", ylabel="wrong among the rest, %")
    below.legend(fontsize=6)
    return figure
