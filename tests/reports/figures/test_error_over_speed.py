"""Error over speed and over the time of the frames, of a synthetic result whose captures move."""

import numpy as np
import pytest

from handbench.bench.evaluation.tables import SCORES, frame
from handbench.bench.results.result_folder import load, write_tables
from handbench.reports.figures.motion import error_over_frames, errors_over_speed
from tests.reports.synthetic_result import METHODS, write_synthetic

SPEEDS_MM_S = {"B": 0.0, "F": 20.0, "U": 100.0, "V": 400.0}  # W's is unknown
FRAMES = 4


def lines_of(capture: str, method: str) -> list[tuple]:
    """Lines of the table of scores: 3-FSK measures velocities, unambiguous up to 300 mm/s."""
    speed_mm_s, found = SPEEDS_MM_S.get(capture), []
    for number in range(FRAMES if capture == "U" else 1):
        figures = {"mae_mm": 1.0 + number + len(method), "start_s": 0.1 * number}
        if speed_mm_s is not None:
            figures |= {"speed_mm_s": speed_mm_s, "step_time_s": 1e-3}
            if method == "3fsk":
                figures |= {"velocity_mae_mm_s": 3.0}
                figures |= {"velocity_beyond_percent": 50.0 * (speed_mm_s > 300)}
        found += [(capture, method, "truth", "", number, *each) for each in figures.items()]
    return found


@pytest.fixture
def moving(tmp_path):
    folder = write_synthetic(tmp_path / "r", references=("truth",))
    rows = [row for c in (*SPEEDS_MM_S, "W") for m in METHODS for row in lines_of(c, m)]
    write_tables(folder, scores=frame(SCORES, rows))
    return load(folder)


def test_figures_draw_what_is_there(moving):
    depth, velocity = errors_over_speed(moving).figure.axes
    mine = [line.get_xydata() for line in depth.lines if line.get_label() == "Broadband"]
    assert sorted(np.concatenate(mine).tolist()) == [[mm_s, 10.0] for mm_s in SPEEDS_MM_S.values()]
    rings = [line.get_xydata().tolist() for line in velocity.lines if line.get_markersize() > 4]
    assert [[400.0, 3.0]] in rings
    [axis] = error_over_frames(moving).figure.axes  # of U, the only sequence
    [mine] = [line for line in axis.lines if line.get_label() == "Broadband"]
    np.testing.assert_allclose(mine.get_ydata(), 10.0 + np.arange(FRAMES))
