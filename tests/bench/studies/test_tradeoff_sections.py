"""The trade-off of photogrammetry, simulation and registration: what each section counts, and one small real run."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.simulated import write_photos
from handbench.bench.run.outcome import Capture
from handbench.bench.scenes.build import build, load_scene
from handbench.bench.scenes.echoes import echo_scene
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.studies.tradeoff import groundtruth_stage, registration_stage, simulation_stage
from handbench.bench.studies.tradeoff.groundtruth_stage import GroundTruthKnobs
from handbench.bench.studies.tradeoff.opening import Context
from handbench.bench.studies.tradeoff.registration_stage import RegistrationKnobs
from handbench.bench.studies.tradeoff.simulation_stage import SimulationKnobs, Way
from handbench.calibration.registration.rigid_fit import Pairs
from handbench.calibration.spheres.description import Candidate
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.cameras.cameras import load_cameras
from handbench.groundtruth.mesh.surface import Surface
from handbench.groundtruth.photos.photos import find_photos
from handbench.radar.simulation.scene_echoes import bare_echoes
from handbench.support.config import parse
from handbench.support.errors import HandbenchError

ANY = tuple(range(5))
POSES_S = 1e4  # that a stand-in for photogrammetry says of the cameras' poses: far more than any machine takes
MEASURED_S = 1e4  # the same of a stand-in for a capture of the target for it
NO_SHADOWS = ("shadow_diffraction", "shadow_antennas", "shadow_centre")
BALL = {
    "version": 1,
    "name": "ball",
    "seed": 3,
    "target": {"kind": "sphere", "radius_m": 0.03, "edge_m": 0.004, "material": {"kind": "skin"}},
    "photos": {"cameras": 4, "width": 600, "height": 400},
}


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> Capture:
    """A capture without echoes: photographs, truth and description."""
    folder = tmp_path_factory.mktemp("ball") / "capture"
    write_photos(build(parse(SceneFile, BALL, "the ball")), folder)
    return Capture(folder, "", open_capture(folder).about)


def context(folder: Path, *captures: Capture, bench=None, base: Path | None = None, repeats: int = 1) -> Context:
    return Context(bench, base or folder, folder, list(captures), seed=1, repeats=repeats)


# --- ground truth ---------------------------------------------------------------------------------------------------


def test_a_ball_is_photographed_and_measured(ball, tmp_path):
    knobs = GroundTruthKnobs(views=(4, 9), long_px=(5000,), quality=("normal",))  # there are 4 photographs of 600 px
    section, (setting,) = groundtruth_stage.measure(knobs, context(tmp_path, ball))
    assert setting.name == section.reference == "4-views-600-px-normal"
    assert json.loads(setting.knobs) == {"views": 4, "long_px": 600, "quality": "normal"}
    assert 0.005 < setting.error < 1 and setting.low is None  # mm, at 0.75 mm a pixel; one capture
    assert setting.seconds > 0 and setting.seconds_low is None
    assert 0 < setting.seen_percent < 100
    assert not any(tmp_path.iterdir())


@pytest.fixture
def shifted(monkeypatch):
    """In place of reconstructions: the true surface, 0.2 mm too small in radius but for its lower half, which was not
    seen. Keeps what was asked for; draft is refused when `refuse` is set."""
    asked = []

    def reconstruct(photos, options, work):
        asked.append(
            SimpleNamespace(
                photos=find_photos(photos),
                cameras=load_cameras(photos / "cameras.json"),
                quality=options.quality,
                fresh=not work.exists(),
            )
        )
        work.mkdir(exist_ok=True)
        if options.quality == "draft" and reconstruct.refuse:
            raise HandbenchError("too blurred")
        time.sleep(0.02)
        return SimpleNamespace(surface=reconstruct.surface, seconds={"sparse": POSES_S})

    reconstruct.refuse, reconstruct.asked = False, asked
    monkeypatch.setattr(groundtruth_stage, "reconstruct", reconstruct)
    return reconstruct


def too_small(ball: Capture) -> Surface:
    photo_from_radar = load_transform(ball.folder / "truth_radar_from_photo.json").inverse()
    scene = build(parse(SceneFile, {**BALL, "target": {**BALL["target"], "edge_m": 0.002}}, "the ball"))
    vertices_m = np.asarray(scene.target_mesh.vertices)
    centre_m = np.array([0, 0, 0.3])
    vertices_m = centre_m + (vertices_m - centre_m) * (1 - 2e-4 / 0.03)
    seen = vertices_m[:, 1] > 0
    faces = np.asarray(scene.target_mesh.triangles)
    return Surface(photo_from_radar.points(vertices_m), faces, np.full(len(seen), 1e-4), seen)


def test_the_error_is_the_distance_where_both_surfaces_are(ball, shifted, tmp_path):
    shifted.surface = too_small(ball)
    knobs = GroundTruthKnobs(views=(3, 4), long_px=(300, 600), quality=("draft", "normal"))
    section, settings = groundtruth_stage.measure(knobs, context(tmp_path, ball))
    assert [s.name for s in settings] == [
        f"{n}-views-{px}-px-{q}" for n in (3, 4) for px in (300, 600) for q in ("draft", "normal")
    ]
    assert section.reference == settings[-1].name
    for setting in settings:
        assert setting.error == pytest.approx(0.2, abs=0.06)  # the true surface has edges of 4 mm: flat to 0.06 mm
        share = setting.seen_percent
        assert share == pytest.approx(49, abs=2)  # half the disc, less the rim
    assert all(0 < s.seconds < POSES_S for s in settings[::2])  # the cameras' poses are in their own time,
    assert all(POSES_S < s.seconds < 2 * POSES_S for s in settings[1::2])  # or counted with what shares them


def test_pictures_shrink_with_their_cameras(ball, shifted, tmp_path):
    shifted.surface = too_small(ball)
    groundtruth_stage.measure(GroundTruthKnobs(views=(3,), long_px=(300,), quality=("draft",)), context(tmp_path, ball))
    first, timed = shifted.asked
    assert first.fresh and timed.fresh  # the first is not counted, and leaves nothing for the second
    assert [photo.name for photo in timed.photos] == ["cam00.jpg", "cam01.jpg", "cam02.jpg"]
    assert {(photo.width, photo.height) for photo in timed.photos} == {(300, 200)}
    whole = {camera.name: camera for camera in load_cameras(ball.folder / "photos" / "cameras.json")}
    for camera in timed.cameras:
        before = whole[camera.name]
        assert (camera.width, camera.height) == (300, 200)
        np.testing.assert_allclose(camera.params[:4], np.array(before.params[:4]) / 2)
        np.testing.assert_allclose(camera.params[4:], before.params[4:])


def test_what_is_refused_has_no_figures(ball, shifted, tmp_path, capsys):
    shifted.surface, shifted.refuse = too_small(ball), True
    knobs = GroundTruthKnobs(views=(4,), long_px=(600,), quality=("draft", "normal"))
    _, (draft, normal) = groundtruth_stage.measure(knobs, context(tmp_path, ball))
    assert draft.error is None and draft.seconds is None and draft.title.endswith("(refused)")
    assert normal.error is not None and normal.seconds < POSES_S  # what the refused one left is not shared
    assert shifted.asked[-1].fresh
    assert "too blurred" in capsys.readouterr().err


def test_without_a_known_surface_there_is_nothing_to_measure(ball, tmp_path, capsys):
    assert groundtruth_stage.measure(GroundTruthKnobs(), context(tmp_path)) is None
    assert "no capture has photographs, truth.ply" in capsys.readouterr().err


def test_views_are_spread_over_the_rig(ball):
    photos = find_photos(ball.folder / "photos") * 2
    assert [photo.name for photo in groundtruth_stage.spread(photos, 5)] == [f"cam0{i}.jpg" for i in (0, 1, 3, 0, 2)]
    assert groundtruth_stage.spread(photos, 8) == photos


# --- simulation -----------------------------------------------------------------------------------------------------


def test_maps_of_a_sphere_are_held_against_exact_ones(tmp_path):
    """Mie's series is the reference: of a sphere of metal, two bounces change nothing and shadows little."""
    knobs = SimulationKnobs(
        scenes=("sphere of 5 mm, metal",), facets_per_wavelength=(4, 1), mirrors_per_wavelength=(4,), nodes_apart=(1, 2)
    )
    section, settings = simulation_stage.measure(knobs, context(tmp_path, repeats=2))
    found = {setting.name: setting for setting in settings}
    assert section.reference == settings[0].name == "all-effects"
    assert {"1-facets-1-mirrors-all-effects", "nodes-2-times-as-far-apart-all-effects", "auto-at-0.1-mm"} <= set(found)
    assert found["all-effects"].error < 0.05 < found["1-facets-1-mirrors-all-effects"].error + 0.05
    assert all(0 < setting.seen_percent <= 100 for setting in settings)
    assert all(s.seconds_low <= s.seconds <= s.seconds_high and s.low is None for s in settings)
    assert list((tmp_path / "exact").iterdir())  # kept: another run makes none


def test_sampling_is_of_facets(small_bench):
    scene = echo_scene(load_scene(small_bench.parent / "ball.toml"))
    sampled = [replace(scene, coarser=simulation_stage.ORDINARY / n) for n in (1.0, 4.0, 8.0)]
    counts = [len(bare_echoes(one).surface.facets) for one in sampled]
    assert counts[1] == len(bare_echoes(scene).surface.facets)
    assert counts[0] < counts[1] < counts[2]


def test_what_another_does_is_not_listed_beside_it(small_bench):
    """Diffracted shadows contain each antenna's sharp ones, and these the centre's, which are on where the former are
    left out."""
    scene = echo_scene(load_scene(small_bench.parent / "ball.toml"))

    def on(*without: str) -> set[str]:
        return {choice.effect for choice in Way(without=without).choices(scene) if choice.on}

    shadows = set(NO_SHADOWS)
    assert on() & shadows == {"shadow_diffraction"}
    assert on("shadow_diffraction") & shadows == {"shadow_antennas"}
    assert on("shadow_diffraction", "shadow_antennas") & shadows == {"shadow_centre"}
    assert not on(*NO_SHADOWS) & shadows
    assert "noise" not in on()  # the scene has no cause for it


def test_pixels_that_one_map_has_are_told():
    ours, exact = np.array([1.0, 2.0, np.nan, 4.0]), np.array([1.001, np.nan, 3.0, 4.003])
    error_mm, both = simulation_stage.compared(ours, exact)
    assert error_mm == pytest.approx(2.0) and both == 0.5
    assert simulation_stage.compared(ours, np.full(4, np.nan)) == (np.inf, 0.0)


def test_an_unknown_scene_is_refused():
    with pytest.raises(HandbenchError, match="no exact scene; did you mean 'one finger, skin'"):
        parse(SimulationKnobs, {"scenes": ["one fingr, skin"]}, "tradeoff.simulation")


def test_an_unknown_effect_is_refused():
    with pytest.raises(HandbenchError, match="'multipth' is not an effect; did you mean 'multipath'"):
        parse(SimulationKnobs, {"without": [["multipth"]]}, "tradeoff.simulation")


# --- registration ---------------------------------------------------------------------------------------------------


def test_the_target_is_registered(tmp_path, monkeypatch):
    """With the echoes' first, coarse centres: fitting them to the samples takes most of the time."""
    monkeypatch.setattr(
        "handbench.calibration.registration.register.fit_balls", lambda capture, target, found, balls: found
    )
    section, (setting,) = registration_stage.measure(RegistrationKnobs(captures=(1,), trials=1), context(tmp_path))
    assert setting.name == section.reference == "1-capture"
    assert 0.005 < setting.error < 2  # mm
    assert (setting.low, setting.high) == (None, None)  # one rig tells of no other
    assert setting.acquisition_s == pytest.approx(0.128)  # 128 tones
    assert setting.seconds > 0
    assert not any(tmp_path.iterdir())


def test_the_rig_stands_still_while_the_target_moves(tmp_path):
    first, *others = registration_stage.placements(300, 3, tmp_path)
    for case in others:
        scene = case.scene
        np.testing.assert_array_equal(scene.radar_from_photo.matrix, first.scene.radar_from_photo.matrix)
        assert scene.target == first.scene.target  # made once
        assert scene.file.sensor == first.scene.file.sensor
        shift_m = scene.radar_from_target.matrix[:3, 3] - first.scene.radar_from_target.matrix[:3, 3]
        assert np.linalg.norm(shift_m) > 1e-3
        assert scene.file.seed != first.scene.file.seed  # for its noise


@pytest.fixture
def drawn(monkeypatch):
    """In place of simulation and detection: centres with errors of 0.1 mm, and 1 s each."""
    sigma_m, refused = 1e-4, set()

    def measured(case):
        if case.number in refused:
            return None
        scene = case.scene
        rng = np.random.default_rng(case.number)
        radar_m = scene.radar_from_target.points(scene.target.centres_m)
        photo_m = scene.radar_from_photo.inverse().points(radar_m)
        sides = (
            [Candidate(p, sigma_m**2 * np.eye(3), ANY) for p in side + sigma_m * rng.standard_normal(side.shape)]
            for side in (photo_m, radar_m)
        )
        return registration_stage.Measured(case, Pairs.of(*sides), np.zeros((3, 3)), MEASURED_S)

    monkeypatch.setattr(registration_stage, "_measured", measured)
    return refused


def test_independent_errors_average_out(drawn, tmp_path):
    knobs = RegistrationKnobs(captures=(1, 4, 16), trials=6)
    section, settings = registration_stage.measure(knobs, context(tmp_path))
    one, four, sixteen = (setting.error for setting in settings)
    assert section.reference == "1-capture"
    assert one / four == pytest.approx(2, rel=0.25)
    assert four / sixteen == pytest.approx(2, rel=0.5)  # six combinations alone
    assert [round(setting.seconds / MEASURED_S) for setting in settings] == [1, 4, 16]
    assert [setting.acquisition_s for setting in settings] == pytest.approx([0.128, 0.512, 2.048])
    assert all(setting.low < setting.error < setting.high for setting in settings)


def test_the_same_seed_gives_the_same_errors(drawn, tmp_path):
    knobs = RegistrationKnobs(captures=(2,), trials=2)
    once, again, other = (
        registration_stage.measure(knobs, replace(context(tmp_path), seed=seed))[1][0].error for seed in (1, 1, 2)
    )
    assert once == again != other


def test_refused_captures_are_done_without(drawn, tmp_path):
    first = 100 * 100
    drawn |= {first, first + 1, first + 2}
    _, (one, four) = registration_stage.measure(RegistrationKnobs(captures=(1, 4), trials=1), context(tmp_path))
    assert one.error is not None
    assert four.error is None and four.seconds is None


def test_the_interval_of_a_root_mean_square_holds_it():
    """Of mean squares of 3 degrees of freedom over 8 rigs: 95 % of 2000 intervals, less what the jackknife's own lack
    of so small a sample takes (it is measured, 92 %)."""
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(2000):
        interval = registration_stage.rms_interval_mm(1e-6 * rng.chisquare(3, 8) / 3)
        held += interval.low < 1 < interval.high
    assert 0.89 < held / 2000 < 0.97
    assert registration_stage.rms_interval_mm(np.array([1e-6])) is None
