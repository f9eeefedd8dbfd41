"""The benchmark of the registration: what it counts, on errors that are known."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.bench.scenes.target_placements import manufactured_target, optical_cloud
from handbench.calibration.spheres.description import default_target, match
from handbench.calibration.spheres.optical_detection import find_spheres
from handbench.calibration.transforms import Transform
from handbench.support.errors import HandbenchError
from tests.bench.studies.registration import measure_registration
from tests.bench.studies.registration.faulty_placements import case, wrong
from tests.bench.studies.registration.measure_registration import (
    FAULTS,
    draw,
    summary,
    tables,
    tried,
)
from tests.bench.studies.registration.registration_score import score


@pytest.fixture(scope="module")
def placement(tmp_path_factory):
    return case(3, tmp_path_factory.mktemp("placement"), photographs=False)


def test_a_known_error_is_what_is_scored():
    """1 mm along x and 2 mrad about z: at (0, 0, 0.3) the turn moves nothing, at the volume's
    corners by 2 mrad times the distance from the axis."""
    true = Transform("photo", "radar", np.eye(4))
    turn = np.array([[1, -2e-3, 0], [2e-3, 1, 0], [0, 0, 1]])
    turn, _ = np.linalg.qr(turn)
    turn *= np.sign(np.diag(turn))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[0, 3] = turn, 1e-3
    found = score(
        Transform("photo", "radar", matrix, np.diag([1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3]) ** 2),
        true,
    )
    np.testing.assert_allclose(found.shift_m, [1e-3, 0, 0], atol=1e-9)
    np.testing.assert_allclose(found.turn_rad, [0, 0, 2e-3], atol=1e-8)
    corner_m = np.hypot(1e-3 + 2e-3 * 0.1, 2e-3 * 0.06)  # shift and turn add up at (0.06, −0.1)
    assert found.tre_m.max() == pytest.approx(corner_m, rel=1e-3)


def test_honest_errors_fall_into_the_band_and_others_do_not():
    """200 errors drawn from their covariance, and the same with a covariance of a quarter."""
    rng = np.random.default_rng(4)
    covariance = np.diag([1e-4, 2e-4, 3e-4, 1e-3, 5e-4, 8e-4]) ** 2
    true = Transform("photo", "radar", np.eye(4))

    def trial(claimed: np.ndarray):
        step = rng.multivariate_normal(np.zeros(6), covariance)
        matrix = np.eye(4)
        skew = np.cross(np.eye(3), step[3:])
        matrix[:3, :3] = np.linalg.svd(np.eye(3) - skew)[0] @ np.linalg.svd(np.eye(3) - skew)[2]
        matrix[:3, 3] = step[:3]
        return score(Transform("photo", "radar", matrix, claimed), true)

    honest, bold = (
        summary([trial(claimed) for _ in range(200)]) for claimed in (covariance, covariance / 4)
    )
    assert honest["band"][0] < honest["nees"] < honest["band"][1]
    assert honest["within_95"] == pytest.approx(0.95, abs=0.05)
    assert honest["predicted_over_seen"] == pytest.approx(1, abs=0.1)
    assert bold["nees"] > 3 * bold["band"][1]


def test_a_target_is_made_within_its_tolerances():
    described, rng = default_target(), np.random.default_rng(0)
    targets = [manufactured_target(described, rng) for _ in range(200)]
    offsets_m = np.array([t.ball_offsets_m for t in targets])
    radii_m = np.array([[e.sphere_radius_m for e in t.element] for t in targets])
    assert offsets_m.std() == pytest.approx(described.ball_offset_sigma_m, rel=0.05)
    assert (radii_m - radii_m.mean(axis=0)).std() == pytest.approx(
        described.sphere_radius_sigma_m, rel=0.1
    )
    assert np.std([t.foam_permittivity for t in targets]) == pytest.approx(0.003, rel=0.2)
    np.testing.assert_allclose(wrong(described).centres_m, described.centres_m * 7 / 6)


def test_the_cloud_shows_the_spheres_where_they_are(placement):
    """To 0.02 mm (the errors drawn are 0.03 mm a point, over a thousand points), from the cameras'
    side alone."""
    points_m, normals = optical_cloud(placement)
    seen = match(
        find_spheres(points_m, normals, placement.described), placement.described, "photographs"
    )
    scene = placement.scene
    true_m = scene.radar_from_photo.inverse().points(
        scene.radar_from_target.points(scene.target.centres_m)
    )
    assert sorted(seen) == [0, 1, 2, 3, 4]
    for i, sphere in seen.items():
        assert np.linalg.norm(sphere.centre_m - true_m[i]) < 2e-5
        assert 0.3 < sphere.coverage < 0.7


@pytest.mark.parametrize(
    ("number", "fault", "heard", "seen"),
    [
        (0, "none", 5, 5),
        (1, "two hidden", 3, 3),
        (9, "two hidden", 3, 5),
        (3, "fifth missing", 4, 4),
        (5, "wrong file", 5, 5),
    ],
)
def test_faults_hide_what_they_say(tmp_path, number, fault, heard, seen):
    found = case(number, tmp_path, fault, photographs=False)
    assert fault in FAULTS
    assert (len(found.heard), len(found.seen)) == (heard, seen)
    assert (found.described == default_target()) == (fault != "wrong file")


def test_the_page_names_every_refusal(placement):
    def refuses():
        raise HandbenchError("photographs: two ways; turn it")

    good = Transform("photo", "radar", placement.scene.radar_from_photo.matrix, np.eye(6) * 1e-8)
    rows, summaries = tables([tried(placement, lambda: good), tried(placement, refuses)])
    cells = [cell.strip() for cell in summaries.markdown().splitlines()[2].split("|")]
    assert cells[1:7] == ["none", "2", "1", "1", "0", "0.000"]
    assert "none: photographs: two ways; turn it" in summaries.markdown()
    assert len(draw({"rows": rows.frame}).axes) == 3


def test_the_script_runs(tmp_path, monkeypatch, capsys):
    """With the echoes' first, coarse centres: fitting them to the samples takes most of the
    time."""
    monkeypatch.setattr(
        "handbench.calibration.registration.register.fit_balls",
        lambda capture, target, found, balls: found,
    )
    monkeypatch.setattr("sys.argv", ["measure", "faults", "--trials", "1", "-o", str(tmp_path)])
    measure_registration.main()
    assert "| none" in capsys.readouterr().out
    assert (tmp_path / "registration_faults.csv").is_file()
