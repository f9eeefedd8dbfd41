"""Placements of the calibration target simulated, calibrated as a user would, and compared with the
truth.

python -m tests.bench.studies.registration.measure_registration full|faults [--trials N] [-o DIR]

`full`: photographs and echoes simulated. `faults`: echoes simulated, clouds drawn, something wrong
with every second placement.
"""

from __future__ import annotations

import argparse
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import chi2

from handbench.bench.datasets.native import TARGET
from handbench.bench.datasets.simulated import simulate_capture
from handbench.bench.evaluation.tables import declared_tables
from handbench.bench.run.photogrammetry import calibrate_captures
from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.echoes import choices, echo_scene
from handbench.bench.scenes.target_placements import optical_cloud
from handbench.calibration.registration.register import measure, solve
from handbench.calibration.spheres.description import save_target
from handbench.calibration.transforms import Transform
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.scene import Ball, EchoScene
from handbench.radar.simulation.simulate import simulate_scene
from handbench.support.errors import HandbenchError
from tests.bench.studies.columns import Record, Table
from tests.bench.studies.registration.faulty_placements import Case, case
from tests.bench.studies.registration.registration_score import Score, score
from tests.bench.studies.script import measured
from tests.bench.studies.study import BLUE, Study

SCHEMAS = declared_tables(__file__)
FAULTS = {
    "none": "the target as described, in view",
    "two hidden": "two elements of the square are covered: from the radar, in every second "
    "placement from cameras too",
    "fifth missing": "the element that breaks the symmetry is missing: likewise",
    "wrong file": "the description is of a target whose square is 20 mm larger",
    "clutter": "a metal ball stands beside the target whose echo is up to 16 dB stronger than "
    "the target's balls'",
}
CLUTTER_M = (0.010, 0.030)  # radius of the ball that stands beside the target, at least and at most
APART_M = 0.06  # from the target's balls, at least: nearer it would not be beside it
TRIALS = {"full": 20, "faults": 200}
# an error of the transform, anywhere in the hand's volume, that should have been a refusal
WRONG_M = 2e-3


def study(work: Path, what: str, trials: int | None) -> Study:
    """One of the two, of so many placements."""
    faults = [one for fault in FAULTS if fault != "none" for one in ("none", fault)]
    count = trials or TRIALS[what]
    return Study(
        f"registration_{what}",
        "Registration of photographs and radar",
        [
            (number, faults[number % len(faults)] if what == "faults" else "none")
            for number in range(count)
        ],
        (lambda chosen: photographed(chosen[0], work))
        if what == "full"
        else (lambda chosen: sampled(*chosen, work)),
        tables,
        draw,
        label=lambda chosen: f"placement {chosen[0]}, {chosen[1]}",
    )


def tables(records: list[Record]) -> list[Table]:
    """A record a placement, and a summary of each fault with the refusals word for word."""
    reasons = dict.fromkeys(f"- {r['fault']}: {r['refused']}\n" for r in records if r["refused"])
    faults = [
        [r for r in records if r["fault"] == fault]
        for fault in dict.fromkeys(r["fault"] for r in records)
    ]
    summaries = Table(
        "summary",
        SCHEMAS["summary"].columns,
        [summarised(of_it) for of_it in faults],
        note="".join(reasons),
    )
    return [Table("rows", SCHEMAS["rows"].columns, records, shown=False), summaries]


def summarised(records: list[Record]) -> Record:
    """The outcome of one fault's placements."""
    scores = [record["score"] for record in records if not record["refused"]]
    return {
        "fault": records[0]["fault"],
        "trials": len(records),
        "calibrated": len(scores),
        "refused": len(records) - len(scores),
        "wrong": sum(float(s.tre_m.max()) > WRONG_M for s in scores),
        **(summary(scores) if scores else {}),
        "seconds": float(np.median([record["seconds"] for record in records])),
    }


def summary(scores: Sequence[Score]) -> Record:
    """Over all trials: root mean squares of shift and turn, the 95th percentile of the registration
    error over the volume, its predicted root mean square over the one seen, and the mean NEES with
    the band that holds 95 % of what honest covariances give."""
    shift2, turn2 = (
        np.array([(getattr(s, key) ** 2).sum() for s in scores]) for key in ("shift_m", "turn_rad")
    )
    tre_m, predicted_m = (
        np.concatenate([getattr(s, key) for s in scores]) for key in ("tre_m", "predicted_m")
    )
    nees = np.array([s.nees for s in scores])
    return {
        "shift_rms_m": float(np.sqrt(shift2.mean())),
        "turn_rms_rad": float(np.sqrt(turn2.mean())),
        "turn_max_rad": float(np.sqrt(turn2.max())),
        "tre_p95_m": float(np.quantile(tre_m, 0.95)),
        "predicted_over_seen": float(np.sqrt((predicted_m**2).mean() / (tre_m**2).mean())),
        "nees": float(nees.mean()),
        "band": tuple(float(chi2.ppf(p, 6 * len(scores)) / len(scores)) for p in (0.025, 0.975)),
        "within_95": float(np.mean(nees < chi2.ppf(0.95, 6))),
    }


def photographed(number: int, work: Path) -> Record:
    """Photographs and echoes simulated into a capture folder, and the calibration of that
    folder."""
    folder = work / f"placement-{number}"
    chosen = case(number, folder)
    capture = folder / "capture"
    if not capture.exists():
        simulate_capture(chosen.scene, capture)
        save_target(capture / TARGET, chosen.described)
    found = tried(chosen, lambda: calibrate_captures([capture], "draft", seed=0))
    shutil.rmtree(capture)  # 20 MB each
    return found


def sampled(number: int, fault: str, work: Path) -> Record:
    """Echoes simulated; in place of photographs a cloud of what the cameras would see of the
    spheres."""
    chosen = case(number, work / f"placement-{number}", fault, photographs=False)
    points_m, normals = optical_cloud(chosen, chosen.seen)
    echoes = _echoes(chosen)

    def registered() -> Transform:
        pairs, common_m2 = measure(points_m, normals, echoes, chosen.described)
        return solve(pairs, common_m2=common_m2)

    return tried(chosen, registered)


def tried(chosen: Case, work: Callable[[], Transform]) -> Record:
    """The record of a case: its errors, or why it was refused."""
    record, start = (
        {"placement": chosen.number, "fault": chosen.fault, "refused": ""},
        time.perf_counter(),
    )
    try:
        found = work()
    except HandbenchError as error:
        return {**record, "seconds": time.perf_counter() - start, "refused": str(error)}
    record["seconds"] = time.perf_counter() - start
    s = score(found, chosen.scene.radar_from_photo)
    return record | {
        "score": s,
        "shift_m": float(np.linalg.norm(s.shift_m)),
        "turn_rad": float(np.linalg.norm(s.turn_rad)),
        "tre_max_m": float(s.tre_m.max()),
        "tre_rms_m": float(np.sqrt((s.tre_m**2).mean())),
        "predicted_rms_m": float(np.sqrt((s.predicted_m**2).mean())),
        "nees": s.nees,
    }


def _echoes(chosen: Case) -> RadarCapture:
    scene = only(chosen.scene, chosen.heard)
    radar_scene = echo_scene(scene)
    if chosen.fault == "clutter":
        radar_scene = replace(
            radar_scene, balls=(*radar_scene.balls, _clutter(radar_scene, chosen.number))
        )
    return simulate_scene(radar_scene, choices(scene, radar_scene)).capture


def only(scene: Scene, shown: tuple[int, ...]) -> Scene:
    """The scene with some of the target's elements alone, for its echoes."""
    target = scene.target
    return replace(
        scene, target=target.model_copy(update={"element": tuple(target.element[i] for i in shown)})
    )


def _clutter(scene: EchoScene, number: int) -> Ball:
    """A bare metal ball somewhere in the searched volume, beside the target."""
    rng = np.random.default_rng([number, 7])
    while True:
        centre_m = rng.uniform((-0.12, -0.12, 0.24), (0.12, 0.12, 0.40))
        if min(np.linalg.norm(centre_m - ball.centre_m) for ball in scene.balls) > APART_M:
            return Ball(centre_m, rng.uniform(*CLUTTER_M))


def draw(frames: dict[str, pd.DataFrame]) -> Figure | None:
    """Error, error in the hand's volume over its prediction, and the distribution of the normalised
    squared error, of the placements that were calibrated; None without one."""
    rows = frames["rows"].query("refused == ''")
    if rows.empty:
        return None
    figure = Figure(figsize=(9.5, 3.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    left.scatter(1e3 * rows.shift_m, np.degrees(rows.turn_rad), s=14, color=BLUE)
    left.set(
        xlabel="shift at the hand's centre in mm", ylabel="turn in °", xlim=0, ylim=0, title="error"
    )
    middle.scatter(1e3 * rows.predicted_rms_m, 1e3 * rows.tre_rms_m, s=14, color=BLUE)
    end = 1.05e3 * rows[["tre_rms_m", "predicted_rms_m"]].to_numpy().max()
    middle.plot([0, end], [0, end], color="0.5", linewidth=0.8)
    middle.set(
        xlabel="predicted, RMS over the volume in mm",
        ylabel="seen in mm",
        xlim=(0, end),
        ylim=(0, end),
    )
    middle.set_title("error in the hand's volume")
    nees = np.sort(rows.nees)
    x = np.linspace(0, max(20, nees[-1]), 200)
    right.plot(x, chi2.cdf(x, 6), color="0.5", linewidth=0.8, label="χ² of 6: honest")
    right.step(
        nees, (np.arange(len(nees)) + 0.5) / len(nees), where="mid", color=BLUE, label="seen"
    )
    right.set(xlabel="normalised squared error", ylabel="share of the trials", title="honesty")
    right.legend(frameon=False, loc="lower right")
    return figure


def main() -> None:
    """Measure, write the files of a study, print the summary."""
    prog = "python -m tests.bench.studies.registration.measure_registration"
    parser = argparse.ArgumentParser(prog=prog, description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "what", choices=list(TRIALS), help="photographs too, or many placements with faults"
    )
    parser.add_argument("--trials", type=int, help="placements (default 20 and 200)")
    measured(parser, study, "registration")


if __name__ == "__main__":
    main()
