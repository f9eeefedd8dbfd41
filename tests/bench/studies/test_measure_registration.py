"""The study of the registration: what it counts, on errors that are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench.studies.registration import measure_registration as study
from handbench.calibration.transforms import Transform
from tests.calibration.seen_target import search_coarsely

TRUE = Transform("photo", "radar", np.eye(4))


def moved(shift_m, turn_rad, covariance):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(turn_rad).as_matrix(), shift_m
    return Transform("photo", "radar", matrix, covariance)


def test_a_known_error_is_what_is_scored():
    """1 mm along x and 2 mrad about z: at (0, 0, 0.3) the turn moves nothing, at the volume's
    corners by 2 mrad times the distance from the axis."""
    covariance = np.diag([1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3]) ** 2
    found = study.score(moved((1e-3, 0, 0), (0, 0, 2e-3), covariance), TRUE)
    np.testing.assert_allclose(found.shift_m, [1e-3, 0, 0], atol=1e-9)
    np.testing.assert_allclose(found.turn_rad, [0, 0, 2e-3], atol=1e-8)
    corner_m = np.hypot(1e-3 + 2e-3 * 0.1, 2e-3 * 0.06)  # shift and turn add up at (0.06, −0.1)
    assert found.tre_m.max() == pytest.approx(corner_m, rel=1e-3)


@pytest.mark.parametrize(
    ("number", "fault", "echoing", "seen"),
    [(0, "none", 5, 5), (9, "two hidden", 3, 5), (3, "fifth missing", 4, 4)],
)
def test_faults_hide_what_they_say(number, fault, echoing, seen):
    assert tuple(map(len, study.shown(number, fault))) == (echoing, seen)


@pytest.mark.slow
def test_a_refusal_is_counted_and_a_placement_scored(ran, monkeypatch, capsys):
    """With the echoes' first, coarse centres: fitting them to the samples takes most of the
    time."""
    search_coarsely(monkeypatch)
    monkeypatch.setattr(
        "handbench.calibration.registration.register.fit_balls",
        lambda capture, target, found, balls: found,
    )
    monkeypatch.setattr(study, "FAULTS", ("two hidden",))
    summaries = ran(study, "faults", "--trials", "2")["summary"]
    assert [(s["fault"], s["calibrated"], s["refused"]) for s in summaries] == [
        ("none", 1, 0),
        ("two hidden", 0, 1),
    ]
    assert "- two hidden: photographs: 3 of 3 detections match" in capsys.readouterr().out
