"""The trials as tables (Markdown, CSV) and as a figure."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import chi2

from bench.studies.registration.run import Trial
from bench.studies.registration.score import Summary, summary
from bench.studies.report import STYLE, markdown_table, write_page

WRONG_M = 2e-3  # an error of the transform, anywhere in the hand's volume, that should have been a refusal


def write(trials: list[Trial], folder: Path, name: str) -> None:
    """Write registration_<name>.md, .csv and .png into the folder."""
    with matplotlib.rc_context(STYLE):
        figure = draw([trial for trial in trials if trial.score])
        write_page(folder / f"registration_{name}", markdown(trials), table(trials), figure)


def table(trials: list[Trial]) -> list[list[str]]:
    """Header and one line per trial."""
    head = ["placement", "fault", "shift mm", "turn °", "largest TRE mm", "predicted TRE mm", "NEES", "s", "refused"]
    return [head, *(_cells(trial) for trial in trials)]


def _cells(trial: Trial) -> list[str]:
    s = trial.score
    figures = (
        ["–"] * 5
        if s is None
        else [
            f"{1e3 * np.linalg.norm(s.shift_m):.3f}",
            f"{np.degrees(np.linalg.norm(s.turn_rad)):.3f}",
            f"{1e3 * s.tre_m.max():.3f}",
            f"{1e3 * np.sqrt((s.predicted_m**2).mean()):.3f}",
            f"{s.nees:.1f}",
        ]
    )
    return [str(trial.case.number), trial.case.fault, *figures, f"{trial.seconds:.1f}", trial.refused]


def markdown(trials: list[Trial]) -> str:
    """What came of each fault, and the figures of the trials that were not refused."""
    lines = [
        [
            "fault",
            "trials",
            "calibrated",
            "refused",
            "wrong",
            "shift RMS mm",
            "turn RMS °",
            "turn max °",
            "TRE p95 mm",
            "mean NEES of 6",
            "its 95 % band",
            "seconds (median)",
        ]
    ]
    for fault in dict.fromkeys(trial.case.fault for trial in trials):
        of_it = [trial for trial in trials if trial.case.fault == fault]
        scores = [trial.score for trial in of_it if trial.score]
        wrong = sum(s.tre_m.max() > WRONG_M for s in scores)
        counts = [fault, len(of_it), len(scores), len(of_it) - len(scores), wrong]
        seconds = f"{np.median([trial.seconds for trial in of_it]):.1f}"
        lines.append([*map(str, counts), *(_figures(summary(scores)) if scores else ["–"] * 6), seconds])
    reasons = dict.fromkeys(f"{trial.case.fault}: {trial.refused}" for trial in trials if trial.refused)
    return markdown_table(lines) + "".join(f"\n- {reason}" for reason in reasons) + "\n"


def _figures(s: Summary) -> list[str]:
    return [
        f"{1e3 * s.shift_rms_m:.3f}",
        f"{np.degrees(s.turn_rms_rad):.3f}",
        f"{np.degrees(s.turn_max_rad):.3f}",
        f"{1e3 * s.tre_p95_m:.3f}",
        f"{s.nees:.2f}",
        f"{s.band[0]:.2f}–{s.band[1]:.2f}",
    ]


def draw(trials: list[Trial]) -> Figure:
    """Errors of the trials that were calibrated, and whether their covariances told them."""
    figure = Figure(figsize=(9.5, 3.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    shift_mm = 1e3 * np.array([np.linalg.norm(t.score.shift_m) for t in trials])
    turn_deg = np.degrees([np.linalg.norm(t.score.turn_rad) for t in trials])
    left.scatter(shift_mm, turn_deg, s=14, color="#0072B2")
    left.set(xlabel="shift at the hand's centre in mm", ylabel="turn in °", xlim=0, ylim=0, title="error")
    seen, predicted = (
        1e3 * np.array([np.sqrt((getattr(t.score, key) ** 2).mean()) for t in trials])
        for key in ("tre_m", "predicted_m")
    )
    middle.scatter(predicted, seen, s=14, color="#0072B2")
    end = 1.05 * max(seen.max(), predicted.max())
    middle.plot([0, end], [0, end], color="0.5", linewidth=0.8)
    middle.set(xlabel="predicted, RMS over the volume in mm", ylabel="seen in mm", xlim=(0, end), ylim=(0, end))
    middle.set_title("error in the hand's volume")
    nees = np.sort([t.score.nees for t in trials])
    share = (np.arange(len(nees)) + 0.5) / len(nees)
    x = np.linspace(0, max(20, nees[-1]), 200)
    right.plot(x, chi2.cdf(x, 6), color="0.5", linewidth=0.8, label="χ² of 6: honest")
    right.step(nees, share, where="mid", color="#0072B2", label="seen")
    right.set(xlabel="normalised squared error", ylabel="share of the trials", title="honesty")
    right.legend(frameon=False, loc="lower right")
    return figure
