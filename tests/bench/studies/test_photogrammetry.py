"""The benchmark of the ground truth: what it counts, on cases with known answers."""

import numpy as np
import pytest

from bench.scenes.rig import rig
from bench.studies.photogrammetry.cases import bars, sweep
from bench.studies.photogrammetry.page import draw, table
from bench.studies.photogrammetry.run import Row
from bench.studies.photogrammetry.score import Score, completeness, scale_error
from calibration.transforms import identity

POINTS_M = np.random.default_rng(0).uniform(-0.05, 0.05, (40, 3)) + (0, 0, 0.3)


def cameras():
    frame = identity("radar")
    return rig(4, 1200, 800, np.array([0.0, 0.0, 0.3]), frame, seed=1)


def test_a_rig_that_is_too_large_makes_everything_too_large():
    """All centres moved away from the origin by 0.2 %, the directions kept: so are the points, to rounding."""
    true = cameras()
    larger = tuple(camera.model_copy(update={"t": tuple((1.002 * camera.translation_m).tolist())}) for camera in true)
    by_name = {camera.name: camera for camera in true}
    assert scale_error(POINTS_M, true, by_name) == pytest.approx(0, abs=1e-9)
    assert scale_error(POINTS_M, larger, by_name) == pytest.approx(0.002, abs=1e-8)


def test_completeness_counts_what_is_within_a_millimetre():
    near = POINTS_M[:30] + (0.0009, 0, 0)
    assert completeness(near, POINTS_M) == pytest.approx(0.75)


def test_every_case_is_a_valid_scene_and_has_a_line():
    cases = [*bars(("C",)), *sweep("W")]
    assert all(case.scene_file().photos.width == case.width for case in cases)
    score = Score(*[1e-5] * 4, 0.9, 1e-4, 1e-5, 0.7, 0.95, 0.94)
    rows = [Row(case, score, {"sparse": 1.0, "dense": 2.0, "mesh": 3.0}, 500.0) for case in cases]
    head, *lines = table(rows)
    assert all(len(line) == len(head) for line in lines)
    assert lines[0][head.index("all s")] == "6.0" and lines[0][head.index("complete %")] == "90.0"
    assert len(draw(rows).axes) == 2
