"""Study of the registration of photographs and radar: placements of the calibration target are
simulated, calibrated as a user would, and the transforms compared with the true ones.

    python -m handbench.bench.studies.registration.measure_registration full|faults
        [--trials N]

`full` simulates photographs and echoes. `faults` simulates echoes, draws the point clouds that
photogrammetry would give, and adds a fault to every second placement.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from handbench.bench.datasets.native import TARGET
from handbench.bench.datasets.simulated import simulate_capture
from handbench.bench.evaluation.tables import declared_tables
from handbench.bench.run.photogrammetry import calibrate_captures
from handbench.bench.scenes.echoes import choices, echo_scene
from handbench.bench.scenes.target_placements import Placement, optical_cloud, placement
from handbench.bench.studies.study import Record, Study, Table, measured, parser
from handbench.bench.tradeoff.simulated_sections import VOLUME_M, errors_m
from handbench.calibration.registration.register import HAND_M, measure, solve
from handbench.calibration.spheres.description import Target, save_target
from handbench.calibration.transforms import Transform, adjoint
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.scene import Ball
from handbench.radar.simulation.simulate import simulate_scene
from handbench.support.errors import HandbenchError

SCHEMAS = declared_tables(__file__)
# Two elements of the square, or the fifth, are covered (in every second placement from the cameras
# too); the square of the description is 20 mm larger; an echo of up to 16 dB above the balls'.
FAULTS = ("two hidden", "fifth missing", "wrong file", "clutter")
CLUTTER_M = (0.010, 0.030)  # radius of the ball that stands beside the target
APART_M = 0.06  # from the target's balls, at least: nearer it would not be beside it
TRIALS = {"full": 20, "faults": 200}
WRONG_M = 2e-3  # an error anywhere in the hand's volume that should have been a refusal


@dataclass(frozen=True)
class PlacementScore:
    """Errors of one estimated transform from the photo frame to the radar frame.

    shift_m [3]: displacement of the hand's centre. turn_rad [3]: rotation error, as a rotation
    vector. tre_m [n]: displacement of points spread over the volume where hands are (VOLUME_M).
    predicted_m [n]: root mean square of these displacements that the transform's covariance
    predicts. nees: eᵀC⁻¹e of the six errors e (shift and rotation); χ²-distributed with 6 degrees
    of freedom if the covariance C is right.
    """

    shift_m: np.ndarray
    turn_rad: np.ndarray
    tre_m: np.ndarray
    predicted_m: np.ndarray
    nees: float


def score(found: Transform, true: Transform) -> PlacementScore:
    """Compute the errors of an estimated transform from the photo frame to the radar frame, and the
    errors that its covariance predicts. true: the true transform."""
    shift_m = found.points(true.inverse().points(HAND_M)) - HAND_M
    turn_rad = Rotation.from_matrix(found.rotation @ true.rotation.T).as_rotvec()
    predicted_m = np.sqrt(np.trace(found.point_covariance(VOLUME_M), axis1=1, axis2=2))
    error, carry = np.concatenate([shift_m, turn_rad]), adjoint(HAND_M, 6)
    nees = error @ np.linalg.solve(carry @ found.covariance @ carry.T, error)
    return PlacementScore(shift_m, turn_rad, errors_m(found, true), predicted_m, float(nees))


def study(work: Path, what: str, trials: int | None) -> Study:
    """Make the study of the registration on simulated placements of the calibration target.

    work: folder for files. what: "full" simulates photographs and echoes; "faults" simulates
    echoes, draws the cameras' point clouds, and adds a fault to every second placement. trials:
    number of placements (None: the default).
    """
    faults = [one for fault in FAULTS for one in ("none", fault)] if what == "faults" else ["none"]
    cases = [(n, faults[n % len(faults)]) for n in range(trials or TRIALS[what])]
    carried_out = photographed if what == "full" else sampled
    return Study(
        f"registration_{what}",
        cases,
        lambda case: carried_out(case[0], case[1], work),
        tables,
        label=lambda case: f"placement {case[0]}, {case[1]}",
    )


def tables(records: list[Record]) -> list[Table]:
    """Make two tables from the records: one row for each placement, and a summary of each fault,
    followed by the reasons why placements were refused."""
    reasons = dict.fromkeys(f"- {r['fault']}: {r['refused']}\n" for r in records if r["refused"])
    faults = dict.fromkeys(r["fault"] for r in records)
    summaries = [summarised([r for r in records if r["fault"] == fault]) for fault in faults]
    return [
        Table("rows", SCHEMAS["rows"].columns, records, shown=False),
        Table("summary", SCHEMAS["summary"].columns, summaries, note="".join(reasons)),
    ]


def summarised(records: list[Record]) -> Record:
    """Summarise the placements with one fault: how many were calibrated, refused, or calibrated
    with an error above 2 mm (WRONG_M); their errors; and the median time."""
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


def summary(scores: Sequence[PlacementScore]) -> Record:
    """Summarise the errors of several registrations. Returns statistics by name.

    They are root mean squares of shift and rotation, the 95th percentile of the displacement over
    the hand's volume, the predicted root mean square displacement divided by the observed one, the
    mean NEES (normalised squared error, eᵀC⁻¹e), and the band that contains 95 % of such means if
    the covariances are right.
    """
    turn_rad = np.linalg.norm([s.turn_rad for s in scores], axis=1)
    tre_m = np.concatenate([s.tre_m for s in scores])
    predicted_m = np.concatenate([s.predicted_m for s in scores])
    nees = np.array([s.nees for s in scores])
    return {
        "shift_rms_m": _rms(np.linalg.norm([s.shift_m for s in scores], axis=1)),
        "turn_rms_rad": _rms(turn_rad),
        "turn_max_rad": float(turn_rad.max()),
        "tre_p95_m": float(np.quantile(tre_m, 0.95)),
        "predicted_over_seen": _rms(predicted_m) / _rms(tre_m),
        "nees": float(nees.mean()),
        "band": tuple(float(chi2.ppf(p, 6 * len(scores)) / len(scores)) for p in (0.025, 0.975)),
        "within_95": float(np.mean(nees < chi2.ppf(0.95, 6))),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def photographed(number: int, fault: str, work: Path) -> Record:
    """Simulate the photographs and echoes of a placement, and calibrate from them. Returns a record
    with the errors, or with the reason why the calibration was refused.

    number: of the placement. fault: "none", for the record. work: folder for the simulated capture.
    """
    folder = work / f"placement-{number}"
    chosen, capture = placement(number, folder, photos={"cameras": 8}), folder / "capture"
    if not capture.exists():
        simulate_capture(chosen.scene, capture)
        save_target(capture / TARGET, chosen.described)
    found = tried(chosen, fault, lambda: calibrate_captures([capture], "draft", seed=0))
    shutil.rmtree(capture)  # 20 MB each
    return found


def sampled(number: int, fault: str, work: Path) -> Record:
    """Simulate the echoes of a placement, draw the point cloud that photogrammetry would give of
    its spheres, and calibrate from both. Returns a record with the errors, or with the reason why
    the calibration was refused.

    number: of the placement. fault: "none", or what is wrong: "two hidden" or "fifth missing"
    (spheres), "wrong file" (description of the target) or "clutter" (a further ball). work: folder
    for files.
    """
    chosen = placement(number, work / f"placement-{number}")
    described = wrong(chosen.described) if fault == "wrong file" else chosen.described
    echoing, seen = shown(number, fault)
    points_m, normals = optical_cloud(chosen, seen)
    capture = _echoes(chosen, echoing, fault == "clutter")

    def registered() -> Transform:
        pairs, common_m2 = measure(points_m, normals, capture, described)
        return solve(pairs, common_m2=common_m2)

    return tried(chosen, fault, registered)


def tried(chosen: Placement, fault: str, work: Callable[[], Transform]) -> Record:
    """Calibrate a placement by calling `work`, and return a record: the time, and the errors of the
    transform or the reason why the calibration was refused. fault: copied to the record."""
    record, start = {"placement": chosen.number, "fault": fault, "refused": ""}, time.perf_counter()
    try:
        found = work()
    except HandbenchError as error:
        return {**record, "seconds": time.perf_counter() - start, "refused": str(error)}
    s = score(found, chosen.scene.radar_from_photo)
    return {
        **record,
        "seconds": time.perf_counter() - start,
        "score": s,
        "shift_m": float(np.linalg.norm(s.shift_m)),
        "turn_rad": float(np.linalg.norm(s.turn_rad)),
        "tre_max_m": float(s.tre_m.max()),
        "tre_rms_m": _rms(s.tre_m),
        "predicted_rms_m": _rms(s.predicted_m),
        "nees": s.nees,
    }


def shown(number: int, fault: str) -> tuple[list[int], list[int]]:
    """Return the indices of the calibration target's five elements (spheres with a ball) that echo,
    and of those that the cameras see, in a placement with this fault. number: of the placement,
    which determines what is hidden."""
    hidden = {"two hidden": (number % 4, (number + 1) % 4), "fifth missing": (4,)}.get(fault, ())
    echoing = [i for i in range(5) if i not in hidden]
    return echoing, echoing if number // 8 % 2 == 0 else list(range(5))


def wrong(target: Target) -> Target:
    """Return the description of a target whose square of spheres is 20 mm larger, as if the user
    named the wrong file."""
    larger = [
        e.model_copy(update={"centre_m": tuple((np.array(e.centre_m) * 7 / 6).tolist())})
        for e in target.element
    ]
    return target.model_copy(update={"element": tuple(larger)})


def _echoes(chosen: Placement, elements: list[int], clutter: bool) -> RadarCapture:
    target = chosen.scene.target
    assert target is not None  # a placement has one
    few = target.model_copy(update={"element": tuple(target.element[i] for i in elements)})
    scene = replace(chosen.scene, target=few)
    radar_scene = echo_scene(scene)
    if clutter:
        ball = _clutter(radar_scene.balls, chosen.number)
        radar_scene = replace(radar_scene, balls=(*radar_scene.balls, ball))
    return simulate_scene(radar_scene, choices(scene, radar_scene)).capture


def _clutter(balls: Sequence[Ball], number: int) -> Ball:
    """Draw a bare metal ball in the volume in which the calibration searches the target, without
    contact to the target's balls. number: of the placement, the seed of the draw."""
    rng = np.random.default_rng([number, 7])
    while True:
        centre_m = rng.uniform((-0.12, -0.12, 0.24), (0.12, 0.12, 0.40))
        if min(np.linalg.norm(centre_m - ball.centre_m) for ball in balls) > APART_M:
            return Ball(centre_m, rng.uniform(*CLUTTER_M))


def main() -> None:
    """Measure the error of the registration of photographs and radar on simulated placements of the
    calibration target, and how often faults are refused; write the tables and print the summary."""
    purpose = "placements of the calibration target against the truth"
    options = parser("registration.measure_registration", purpose)
    what = "photographs too, or many placements with faults"
    options.add_argument("what", choices=list(TRIALS), help=what)
    options.add_argument("--trials", type=int, help="placements (default 20 and 200)")
    measured(options, study, "registration")


if __name__ == "__main__":
    main()
