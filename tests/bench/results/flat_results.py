"""Results of one method on flat hands, whose errors are given."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap, error_map
from handbench.bench.evaluation.metrics import figures
from handbench.bench.evaluation.scoring_protocols import PAPER, main_table
from handbench.bench.evaluation.tables import SCORES, TASKS, frame
from handbench.bench.results.about import About, CaptureFacts, MethodFacts, metric_facts
from handbench.bench.results.maps import SurfaceMap, write_surface
from handbench.bench.results.result_folder import Result

AXIS_M = 2.5e-3 * np.arange(36)
REFERENCE_M = np.full((36, 36), 0.3)
NAMES = ("B", "F", "U", "V", "W", "X")
TASK = ("B, 3-FSK", "B", "3fsk", "image", 0.5, 0.9, None, True, None, "", None, None)


def errors_of(errors_mm: np.ndarray, z_m: np.ndarray = REFERENCE_M) -> ErrorMap:
    return error_map(AXIS_M, AXIS_M, z_m + 1e-3 * errors_mm, z_m)


def flat_result(
    folder: Path,
    errors_mm: np.ndarray,
    names: tuple[str, ...] = NAMES,
    shift_m: float = 0.0,
    **facts: object,
) -> Result:
    """A result on flat hands that lie shift_m further away; facts: of its About. The folder has the
    references alone."""
    z_m, lines = REFERENCE_M + shift_m, []
    for name, errors in zip(names, errors_mm, strict=True):
        of_capture = figures(errors_of(errors, z_m))
        lines += [(name, "3fsk", "truth", "", 0, *each) for each in of_capture.items()]
        lines.append((name, "3fsk", "", "", 0, "seconds", 0.5))
        write_surface(folder, name, "truth", SurfaceMap(AXIS_M, AXIS_M, z_m))
    repeated_m = 0.3 + 1e-3 * np.random.default_rng(len(names)).normal(size=10)
    lines += [("B", "3fsk", "", "", i, "strongest_z_m", z) for i, z in enumerate(repeated_m)]
    defaults = {
        "protocol": {"id": "paper", "version": 2, "compared": ["mae_mm", "observed_percent"]},
        "metrics": metric_facts(),
        "inputs": {},
        "versions": {"handbench": "1"},
        "machine": {},
        "captures": tuple(CaptureFacts(name=n, references=("truth",)) for n in names),
        "methods": (MethodFacts(name="3fsk", title="3-FSK", config={"B": {"step_m": 0.001}}),),
    }
    scores = frame(SCORES, lines)
    table = main_table(scores, PAPER, 0, with_paper=False)
    about = About(name="flat", **(defaults | facts))
    config = 'name = "flät"\n[[method]]\nid = "3fsk"\n'
    return Result(folder, about, table, frame(TASKS, [TASK]), scores, config)
