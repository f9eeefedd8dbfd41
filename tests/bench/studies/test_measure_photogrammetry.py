"""The study of the ground truth: what it counts, on answers that are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from handbench.bench.scenes.stand import rig
from handbench.bench.studies.photogrammetry import measure_photogrammetry as study
from handbench.calibration.transforms import identity
from handbench.groundtruth.mesh.surface import Surface

POINTS_M = np.random.default_rng(0).uniform(-0.05, 0.05, (40, 3)) + (0, 0, 0.3)


def test_a_rig_that_is_too_large_makes_everything_too_large():
    """All centres moved away from the origin by 0.2 %, the directions kept: so are the points, to
    rounding."""
    true = rig(4, 1200, 800, np.array([0.0, 0.0, 0.3]), identity("radar"), seed=1)
    larger = tuple(
        camera.model_copy(update={"t": tuple((1.002 * camera.translation_m).tolist())})
        for camera in true
    )
    by_name = {camera.name: camera for camera in true}
    assert study.scale_error(POINTS_M, true, by_name) == pytest.approx(0, abs=1e-9)
    assert study.scale_error(POINTS_M, larger, by_name) == pytest.approx(0.002, abs=1e-8)


@pytest.mark.slow
def test_the_true_surface_a_tenth_of_a_millimetre_too_large_is_scored_so(ran, monkeypatch):
    """In place of minutes of photogrammetry."""
    scenes = []
    monkeypatch.setattr(study, "write_photos", lambda scene, folder: scenes.append(scene))

    def reconstruct(photos, options, workdir):
        [scene] = scenes
        hand = scene.target_mesh.compute_vertex_normals()
        vertices_m = np.asarray(hand.vertices) + 1e-4 * np.asarray(hand.vertex_normals)
        n = len(vertices_m)
        surface = Surface(
            scene.radar_from_photo.inverse().points(vertices_m),
            np.asarray(hand.triangles),
            np.full(n, 1e-4),
            np.ones(n, bool),
        )
        return SimpleNamespace(surface=surface, cameras=scene.cameras, seconds={"sparse": 2.0})

    monkeypatch.setattr(study, "reconstruct", reconstruct)
    words = ["bars", "--poses", "C", "--only", "5 views, speckle"]
    [row] = ran(study, *words)["rows"]
    assert row["signed_m"] == pytest.approx(1e-4, rel=0.1) and row["complete"] > 0.99
    assert abs(row["scale"]) < 1e-6 and row["centre_m"] == 0
    assert row["within_2_sigma"] > 0.99 and row["all_s"] == 2.0
