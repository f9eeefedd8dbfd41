"""The trade-off of photogrammetry, simulation and registration: what each section counts, and one
small real run."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.simulated import write_photos
from handbench.bench.run.benchmark_file import BenchFile, Source
from handbench.bench.run.outcome import Outcome, RunCapture
from handbench.bench.run.sweep import SimulationKnobs, TradeoffSweep
from handbench.bench.scenes.build import build, load_scene
from handbench.bench.scenes.echoes import echo_scene
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.tradeoff import groundtruth, simulated_sections
from handbench.bench.tradeoff.groundtruth import measure_groundtruth
from handbench.bench.tradeoff.settings import TradeoffInputs
from handbench.bench.tradeoff.simulated_sections import (
    SimulationVariant,
    measure_registration,
    measure_simulation,
)
from handbench.calibration.registration.rigid_fit import Pairs
from handbench.calibration.spheres.description import Candidate
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.cameras.cameras import load_cameras
from handbench.groundtruth.mesh.surface import Surface
from handbench.groundtruth.photos.photos import find_photos
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from tests.references.exact.kept_echoes import thin_array

ANY = tuple(range(5))
MEASURED_S = (
    1e4  # that a stand-in for a capture of the target says: far more than any machine takes
)
NO_SHADOWS = ("shadow_diffraction", "shadow_antennas", "shadow_centre")
BALL = {
    "version": 1,
    "name": "ball",
    "seed": 3,
    "target": {"kind": "sphere", "radius_m": 0.03, "edge_m": 0.004, "material": {"kind": "skin"}},
    "photos": {"cameras": 4, "width": 600, "height": 400},
}


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> RunCapture:
    """A capture without echoes: photographs, truth and description."""
    folder = tmp_path_factory.mktemp("ball") / "capture"
    write_photos(build(parse(SceneFile, BALL, "the ball")), folder)
    return RunCapture(folder, "", open_capture(folder).about)


def inputs(
    folder: Path, *captures: RunCapture, seed: int = 1, repeats: int = 1, **knobs: dict
) -> TradeoffInputs:
    """The inputs of a section with these knobs; every capture has a true surface."""
    sweep = parse(TradeoffSweep, {"repeats": repeats, **knobs}, "tradeoff")
    known = {
        "version": 1,
        "name": "swept",
        "capture": (Source(path="ball"),),
        "method": ({"id": "2fsk"},),
    }
    bench = BenchFile(**known, seed=seed, tradeoff=sweep)
    references = {
        capture.name: {"truth": (capture.folder / "truth.ply", None)} for capture in captures
    }
    return TradeoffInputs(
        bench, folder, folder, Outcome(bench, list(captures), [], references=references)
    )


@pytest.fixture
def shifted(monkeypatch):
    """In place of reconstructions: the true surface, 0.2 mm too small in radius but for its lower
    half, which was not seen. Keeps what was asked for; draft is refused."""
    asked = []

    def reconstruct(photos, options, work):
        asked.append((find_photos(photos), load_cameras(photos / "cameras.json"), work))
        if options.quality == "draft":
            raise HandbenchError("too blurred")
        return SimpleNamespace(
            surface=reconstruct.surface, seconds={"sparse": 2.0, "dense": 3.0, "mesh": 0.5}
        )

    reconstruct.asked = asked
    monkeypatch.setattr(groundtruth, "reconstruct", reconstruct)
    monkeypatch.setattr(groundtruth, "compile_kernels", lambda: None)  # which nothing here needs
    return reconstruct


def too_small(ball: RunCapture) -> Surface:
    photo_from_radar = load_transform(ball.folder / "truth_radar_from_photo.json").inverse()
    fine = BALL | {"target": BALL["target"] | {"edge_m": 0.002}}
    mesh = build(parse(SceneFile, fine, "the ball")).target_mesh
    centre_m = np.array([0, 0, 0.3])
    vertices_m = centre_m + (np.asarray(mesh.vertices) - centre_m) * (1 - 2e-4 / 0.03)
    seen, faces = vertices_m[:, 1] > 0, np.asarray(mesh.triangles)
    return Surface(photo_from_radar.points(vertices_m), faces, np.full(len(seen), 1e-4), seen)


@pytest.mark.slow
def test_maps_of_a_sphere_are_held_against_the_finest_simulation(tmp_path, monkeypatch):
    """Of a sphere of metal, two bounces change nothing and shadows little."""
    monkeypatch.setattr(simulated_sections, "qar50", thin_array)
    knobs = {
        "scenes": ("sphere of 5 mm, metal",),
        "facets_per_wavelength": (4, 1),
        "mirrors_per_wavelength": (4,),
        "nodes_apart": (1, 2),
        "without": ((), ("multipath", *NO_SHADOWS)),
        "tolerance_mm": (1.0,),  # of earlier versions: no effect
    }
    measured = measure_simulation(inputs(tmp_path, repeats=2, simulation=knobs))
    section, settings = measured.section, measured.lines
    found = {setting.name: setting for setting in settings}
    assert found["all-effects"].error == 0  # the finest itself
    assert section.reference == settings[0].name == "all-effects"
    assert (
        0 < found["without-multipath-shadow_diffraction-shadow_antennas-shadow_centre"].error < 0.05
    )
    assert all(0 < setting.seen_percent <= 100 for setting in settings)
    assert all(s.seconds_low <= s.seconds <= s.seconds_high and s.low is None for s in settings)


def test_what_another_does_is_not_listed_beside_it(small_bench):
    """Diffracted shadows contain each antenna's sharp ones, and these the centre's, which are on
    where the former are left out."""
    scene = echo_scene(load_scene(small_bench.parent / "ball.toml"))

    def on(*without: str) -> set[str]:
        return {
            choice.effect
            for choice in SimulationVariant(without=without).choices(scene)
            if choice.on
        }

    shadows = set(NO_SHADOWS)
    assert on() & shadows == {"shadow_diffraction"}
    assert on("shadow_diffraction") & shadows == {"shadow_antennas"}
    assert on("shadow_diffraction", "shadow_antennas") & shadows == {"shadow_centre"}
    assert not on(*NO_SHADOWS) & shadows
    assert "noise" not in on()  # the scene has no cause for it


@pytest.fixture
def drawn(monkeypatch):
    """In place of simulation and detection: centres with errors of 0.1 mm, and 1 s each."""
    sigma_m, refused = 1e-4, set()

    def registered(case):
        if case.number in refused:
            raise HandbenchError("too few balls")
        scene = case.scene
        rng = np.random.default_rng(case.number)
        radar_m = scene.radar_from_target.points(scene.target.centres_m)
        photo_m = scene.radar_from_photo.inverse().points(radar_m)
        sides = (
            [
                Candidate(p, sigma_m**2 * np.eye(3), ANY)
                for p in side + sigma_m * rng.standard_normal(side.shape)
            ]
            for side in (photo_m, radar_m)
        )
        return simulated_sections.TargetMeasurement(
            case, Pairs.of(*sides), np.zeros((3, 3)), MEASURED_S
        )

    monkeypatch.setattr(simulated_sections, "measure_placement", registered)
    return refused


def test_the_interval_of_a_root_mean_square_holds_it():
    """Of mean squares of 3 degrees of freedom over 8 rigs: 95 % of 2000 intervals, less what the
    jackknife's own lack of so small a sample takes (it is measured, 92 %)."""
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(2000):
        interval = simulated_sections.rms_interval_mm(1e-6 * rng.chisquare(3, 8) / 3)
        held += interval.low < 1 < interval.high
    assert 0.89 < held / 2000 < 0.97
    assert simulated_sections.rms_interval_mm(np.array([1e-6])) is None


@pytest.mark.slow
def test_the_error_is_the_distance_where_both_surfaces_are(ball, shifted, tmp_path, capsys):
    """Of pictures that shrink with their cameras; what is refused has no figures."""
    shifted.surface = too_small(ball)
    knobs = {"views": (3, 4), "long_px": (300, 600), "quality": ("draft", "normal")}
    found = measure_groundtruth(inputs(tmp_path, ball, groundtruth=knobs))
    every = product(knobs["views"], knobs["long_px"], knobs["quality"])
    assert [s.name for s in found.lines] == [f"{n}-views-{px}-px-{q}" for n, px, q in every]
    assert found.section.reference == found.lines[-1].name
    for draft, normal in zip(found.lines[::2], found.lines[1::2], strict=True):
        assert draft.error is None and draft.seconds is None and draft.title.endswith("(refused)")
        # the true surface has edges of 4 mm: flat to 0.06 mm; half the disc, less the rim
        assert normal.error == pytest.approx(0.2, abs=0.06)
        assert normal.seen_percent == pytest.approx(49, abs=2)
        assert normal.seconds == 5.5  # with the cameras' poses, which two qualities share
    assert "too blurred" in capsys.readouterr().err
    assert len({work for *_, work in shifted.asked}) == 4
    photos, [camera, *_], _ = shifted.asked[0]
    assert [photo.name for photo in photos] == ["cam00.jpg", "cam01.jpg", "cam02.jpg"]
    assert {(photo.width, photo.height) for photo in photos} == {(300, 200)}
    [whole, *_] = load_cameras(ball.folder / "photos" / "cameras.json")
    assert whole.name == camera.name and (camera.width, camera.height) == (300, 200)
    np.testing.assert_allclose(camera.params[:4], np.array(whole.params[:4]) / 2)
    with pytest.raises(HandbenchError, match=r"no capture has photographs, truth\.ply"):
        measure_groundtruth(inputs(tmp_path))


@pytest.mark.parametrize(
    ("knobs", "words"),
    [
        (
            {"scenes": ["one fingr, skin"]},
            "not a scene of fingers; did you mean 'one finger, skin'",
        ),
        ({"without": [["multipth"]]}, "'multipth' is not an effect; did you mean 'multipath'"),
    ],
)
def test_unknown_scenes_and_effects_are_refused(knobs, words):
    with pytest.raises(HandbenchError, match=words):
        parse(SimulationKnobs, knobs, "tradeoff.simulation")


@pytest.mark.slow
def test_independent_errors_average_out(drawn, tmp_path):
    """Refused captures are done without."""

    def measured(seed=1, **knobs):
        return measure_registration(inputs(tmp_path, seed=seed, registration=knobs))

    found = measured(captures=(1, 4, 16), trials=6)
    one, four, sixteen = (setting.error for setting in found.lines)
    assert found.section.reference == "1-capture"
    assert one / four == pytest.approx(2, rel=0.25)
    assert four / sixteen == pytest.approx(2, rel=0.5)  # six combinations alone
    assert [round(setting.seconds / MEASURED_S) for setting in found.lines] == [1, 4, 16]
    assert found.lines[1].acquisition_s == pytest.approx(0.512)  # of 128 tones each
    drawn |= {100 * 100 + k for k in range(3)}
    one, four = measured(captures=(1, 4), trials=1).lines
    assert one.error is not None and four.error is None and four.seconds is None
