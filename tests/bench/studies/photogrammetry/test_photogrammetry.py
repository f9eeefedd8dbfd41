"""The benchmark of the ground truth: what it counts, on cases with known answers."""

import numpy as np
import pytest

from handbench.bench.scenes.stand import rig
from handbench.calibration.transforms import identity
from tests.bench.studies.photogrammetry.measure_photogrammetry import draw, record, tables
from tests.bench.studies.photogrammetry.photogrammetry_cases import bars, sweep
from tests.bench.studies.photogrammetry.photogrammetry_score import completeness, scale_error

POINTS_M = np.random.default_rng(0).uniform(-0.05, 0.05, (40, 3)) + (0, 0, 0.3)


def cameras():
    frame = identity("radar")
    return rig(4, 1200, 800, np.array([0.0, 0.0, 0.3]), frame, seed=1)


def test_a_rig_that_is_too_large_makes_everything_too_large():
    """All centres moved away from the origin by 0.2 %, the directions kept: so are the points, to
    rounding."""
    true = cameras()
    larger = tuple(
        camera.model_copy(update={"t": tuple((1.002 * camera.translation_m).tolist())})
        for camera in true
    )
    by_name = {camera.name: camera for camera in true}
    assert scale_error(POINTS_M, true, by_name) == pytest.approx(0, abs=1e-9)
    assert scale_error(POINTS_M, larger, by_name) == pytest.approx(0.002, abs=1e-8)


def test_completeness_counts_what_is_within_a_millimetre():
    near = POINTS_M[:30] + (0.0009, 0, 0)
    assert completeness(near, POINTS_M) == pytest.approx(0.75)


def test_every_case_is_a_valid_scene_and_has_a_line():
    cases = [*bars(("C",)), *sweep("W")]
    assert all(case.scene_file().photos.width == case.width for case in cases)
    lengths = dict.fromkeys(("median_m", "rms_m", "p95_m", "max_m", "centre_m"), 1e-5)
    score = {
        **lengths,
        "complete": 0.9,
        "scale": 1e-4,
        "within_1_sigma": 0.7,
        "within_2_sigma": 0.95,
        "within_95": 0.94,
    }
    [table] = tables(
        [record(c, score, {"sparse": 1.0, "dense": 2.0, "mesh": 3.0}, 500.0) for c in cases]
    )
    head, _, *lines = (
        [cell.strip() for cell in line.split("|")] for line in table.markdown().splitlines()
    )
    assert len(lines) == len(cases) and all(len(line) == len(head) for line in lines)
    assert lines[0][head.index("all s")] == "6.0" and lines[0][head.index("complete %")] == "90.0"
    assert len(draw({"rows": table.frame}).axes) == 2
