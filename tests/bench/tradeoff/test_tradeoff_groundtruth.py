"""The trade-off of photogrammetry: what its section counts."""

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
from handbench.bench.run.sweep import TradeoffSweep
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.tradeoff import groundtruth
from handbench.bench.tradeoff.groundtruth import measure_groundtruth
from handbench.bench.tradeoff.settings import TradeoffInputs
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.cameras.cameras import load_cameras
from handbench.groundtruth.mesh.surface import Surface
from handbench.groundtruth.photos.photos import find_photos
from handbench.support.config import parse
from handbench.support.errors import HandbenchError

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


def inputs(folder: Path, *captures: RunCapture, **knobs: dict) -> TradeoffInputs:
    """The inputs of a section with these knobs; every capture has a true surface."""
    sweep = parse(TradeoffSweep, knobs, "tradeoff")
    known = {
        "version": 1,
        "name": "swept",
        "capture": (Source(path="ball"),),
        "method": ({"id": "2fsk"},),
    }
    bench = BenchFile(**known, tradeoff=sweep)
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
