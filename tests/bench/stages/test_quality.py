"""The distance of a reconstructed surface from the true one, by closed form."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from handbench.bench.datasets.simulated import write_photos
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.stages import quality
from handbench.bench.stages.quality import has_quality, measure_quality
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.mesh.surface import Surface
from handbench.support.config import parse

BALL = {
    "version": 1,
    "name": "ball",
    "seed": 3,
    "target": {"kind": "sphere", "radius_m": 0.03, "edge_m": 0.004, "material": {"kind": "skin"}},
    "photos": {"cameras": 4, "width": 600, "height": 400},
}


def too_small(ball: Path) -> Surface:
    """The true surface, 0.2 mm too small in radius but for its lower half, which was not seen."""
    photo_from_radar = load_transform(ball / "truth_radar_from_photo.json").inverse()
    fine = BALL | {"target": BALL["target"] | {"edge_m": 0.002}}
    mesh = build(parse(SceneFile, fine, "the ball")).target_mesh
    centre_m = np.array([0, 0, 0.3])
    vertices_m = centre_m + (np.asarray(mesh.vertices) - centre_m) * (1 - 2e-4 / 0.03)
    seen, faces = vertices_m[:, 1] > 0, np.asarray(mesh.triangles)
    return Surface(photo_from_radar.points(vertices_m), faces, np.full(len(seen), 1e-4), seen)


@pytest.mark.slow
def test_the_error_is_the_distance_where_both_surfaces_are(tmp_path, monkeypatch):
    ball = tmp_path / "ball"
    write_photos(build(parse(SceneFile, BALL, "the ball")), ball)
    assert has_quality(ball)
    made = SimpleNamespace(surface=too_small(ball))
    monkeypatch.setattr(quality, "reconstruct", lambda photos, options: made)
    monkeypatch.setattr(quality, "clock_s", iter([2.0, 7.5]).__next__)
    measure_quality(tmp_path, str(ball), "draft", 0)
    found = json.loads((tmp_path / "quality.json").read_text())
    # the true surface has edges of 4 mm: flat to 0.06 mm; half the disc, less the rim
    assert found["surface_rms_mm"] == pytest.approx(0.2, abs=0.06)
    assert found["observed_percent"] == pytest.approx(49, abs=2)
    assert found["seconds"] == 5.5
