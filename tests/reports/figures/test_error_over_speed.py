"""Error over speed and over the time of the frames, of captures that move."""

from dataclasses import replace

import numpy as np

from handbench.bench.evaluation.tables import SCORES, frame
from handbench.bench.results.result_folder import load
from handbench.reports.figures.plots import error_over_frames, errors_over_speed
from tests.golden_files import RESULT

SPEEDS_MM_S = {"B": 0.0, "F": 20.0, "U": 100.0, "V": 400.0, "W": None}  # None: unknown
FRAMES = 4  # of U


def test_figures_draw_what_is_there():
    """3-FSK alone measures velocities, unambiguous up to 300 mm/s."""
    lines = []
    for capture, speed_mm_s in SPEEDS_MM_S.items():
        for method in ("3fsk", "broadband"):
            for number in range(FRAMES if capture == "U" else 1):
                figures = {"mae_mm": 10.0 + number}
                if speed_mm_s is not None:
                    figures |= {"speed_mm_s": speed_mm_s, "step_time_s": 1e-3}
                if speed_mm_s is not None and method == "3fsk":
                    beyond_percent = 50.0 * (speed_mm_s > 300)
                    figures |= {"velocity_mae_mm_s": 3.0, "velocity_beyond_percent": beyond_percent}
                lines += [(capture, method, "truth", "", number, *each) for each in figures.items()]
    result = replace(load(RESULT), scores=frame(SCORES, lines))
    depth, velocity = errors_over_speed(result).figure.axes
    mine = [line.get_xydata() for line in depth.lines if line.get_label() == "broadband"]
    known_mm_s = list(SPEEDS_MM_S.values())[:-1]
    assert sorted(np.concatenate(mine).tolist()) == [[mm_s, 10.0] for mm_s in known_mm_s]
    rings = [line.get_xydata().tolist() for line in velocity.lines if line.get_markersize() > 4]
    assert [[400.0, 3.0]] in rings
    [axis] = error_over_frames(result).figure.axes  # of U, the only sequence
    [mine] = [line for line in axis.lines if line.get_label() == "broadband"]
    np.testing.assert_allclose(mine.get_ydata(), 10.0 + np.arange(FRAMES))
