"""Coordinates of a survey, thousands of kilometres from the origin."""

import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.cameras.camera_files import cameras_in, write_model
from handbench.groundtruth.cameras.cameras import save_cameras
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.groundtruth.options import Options, SparseOptions
from handbench.groundtruth.photos.photos import find_photos
from handbench.groundtruth.pipeline import reconstruct
from handbench.groundtruth.sparse.frame import shift
from handbench.groundtruth.sparse.inputs import SparseInputs, gather
from handbench.groundtruth.sparse.sparse import register
from handbench.support.errors import HandbenchError
from tests.groundtruth.noisy_model import noisy_model
from tests.groundtruth.room import around, photograph, true_camera

FAR_M = np.array([5.1e6, -3.4e6, 1.2e5])  # as a place on the earth


@pytest.mark.slow
def test_a_surface_far_away_is_as_good_as_at_the_origin(tmp_path):
    surfaces = []
    for by_m in (np.zeros(3), FAR_M):
        photos = tmp_path / str(len(surfaces))
        photos.mkdir()
        photograph(photos)
        cameras = [true_camera(f"p{i}.png", np.array(c)) for i, c in enumerate(around(4))]
        save_cameras(photos / "cameras.json", tuple(c.shifted(by_m) for c in cameras))
        box_m = tuple((np.repeat([-0.05, 0.3], 3) + np.tile(by_m, 2)).tolist())
        surfaces.append(reconstruct(photos, Options(quality="draft", box_m=box_m)).surface)
    near, far = surfaces
    # the cameras differ by rounding, 1 nm, after which a few pixels end at another depth
    away_m = np.linalg.norm(far.vertices_m - FAR_M - near.vertices_m, axis=1)
    assert np.percentile(away_m, 95) < 1e-5
    assert away_m.max() < 1e-4
    np.testing.assert_allclose(np.median(far.sigma_m), np.median(near.sigma_m), rtol=1e-3)


def test_cameras_of_a_model_far_away_stay_where_they_are(tmp_path):
    scene, found = noisy_model(), []
    for camera in cameras_in(scene.model):
        Image.new("L", (camera.width, camera.height)).save(tmp_path / camera.name)
    for by_m in (np.zeros(3), FAR_M):
        shift(scene.model, by_m)
        folder = tmp_path / f"model{len(found)}"
        folder.mkdir()
        write_model(scene.model, folder)
        inputs = SparseInputs(find_photos(tmp_path), None, None, {}, folder)
        found.append(register(inputs, SparseOptions(model=folder, metric=True)))
    near, far = found
    for one, other in zip(near.cameras(), far.cameras(), strict=True):
        np.testing.assert_allclose(
            far.origin_m - FAR_M + other.centre_m, near.origin_m + one.centre_m, atol=1e-8
        )


def test_cameras_too_far_for_double_precision_are_named(tmp_path):
    photograph(tmp_path)
    cameras = [true_camera(f"p{i}.png", np.array(c)) for i, c in enumerate(around(4))]
    away_m = np.array([0, 0, 1e9])
    save_cameras(tmp_path / "cameras.json", tuple(c.shifted(away_m) for c in cameras))
    with pytest.raises(HandbenchError, match=r"cameras: are 1e\+09 m from"):
        gather(tmp_path, SparseOptions())


@pytest.mark.parametrize(("by_m", "words"), [(1e5, "single precision has steps"), (10.0, None)])
def test_a_mesh_in_single_precision_is_refused_where_its_steps_are_coarse(tmp_path, by_m, words):
    corners_m = np.float32([(0, 0, by_m), (0.2, 0, by_m), (0, 0.2, by_m + 0.1)])
    mesh = tmp_path / "mesh.obj"
    mesh.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners_m.tolist()) + "f 1 2 3\n")
    if words is None:
        assert len(read_triangles(mesh)[1]) == 1
    else:
        with pytest.raises(HandbenchError, match=words):
            read_triangles(mesh)
