"""Cameras and models that others have made."""

import numpy as np
import pytest
from test_metashape import export

from handbench.groundtruth.cameras.camera_files import (
    cameras_in,
    cameras_of,
    load_model,
    read_model,
)
from handbench.groundtruth.cameras.cameras import save_cameras
from handbench.groundtruth.photos.photos import Photo
from handbench.support.errors import HandbenchError
from tests.groundtruth.synthetic_model import photos_of, synthetic_model

CENTRES = [(1.0, 0.1 * i, 0.2) for i in range(4)]


@pytest.fixture
def model():
    return synthetic_model(CENTRES)


def write(model, folder, binary=True):
    folder.mkdir()
    (model.write_binary if binary else model.write_text)(folder)
    return folder


@pytest.mark.parametrize("binary", [True, False])
def test_a_colmap_model_gives_intrinsics_and_metric_poses_only_if_told_so(
    tmp_path, capsys, model, binary
):
    folder = write(model, tmp_path / "model", binary)
    cameras = cameras_of(photos_of(model), folder, metric=True)
    assert [camera.name for camera in cameras] == ["p0.png", "p1.png", "p2.png", "p3.png"]
    np.testing.assert_allclose([camera.centre_m for camera in cameras], CENTRES, atol=1e-12)
    assert cameras[0].params == tuple(model.cameras[1].params)
    for camera in cameras_of(photos_of(model), folder):
        assert camera.R is None and camera.t is None and camera.params == cameras[0].params
    assert "COLMAP's poses have no unit" in capsys.readouterr().err


def test_every_kind_of_file_names_the_photographs(tmp_path, model):
    photos = photos_of(model)
    save_cameras(tmp_path / "c.json", cameras_in(model))
    assert [camera.name for camera in cameras_of(photos, tmp_path / "c.json")] == [
        photo.name for photo in photos
    ]
    of_metashape = (Photo(None, "DSC_1.JPG", 640, 480), Photo(None, "DSC_2.JPG", 640, 480))
    cameras = cameras_of(of_metashape, export(tmp_path / "cams.xml"))
    assert [(camera.name, camera.R is None) for camera in cameras] == [
        ("DSC_1.JPG", False),
        ("DSC_2.JPG", True),
    ]


def test_a_camera_of_an_upright_picture_is_turned(tmp_path, model):
    save_cameras(tmp_path / "c.json", cameras_in(model))
    photos = tuple(Photo(None, f"p{i}.png", 300, 400, orientation=6) for i in range(4))
    turned = cameras_of(photos, tmp_path / "c.json")
    assert {(camera.width, camera.height) for camera in turned} == {(300, 400)}
    np.testing.assert_allclose([camera.centre_m for camera in turned], CENTRES, atol=1e-12)
    upright_only = tuple(Photo(None, f"p{i}.png", 300, 400) for i in range(4))
    with pytest.raises(
        HandbenchError, match=r"p0\.png is 400 × 300 there, the photograph has 300 × 400 pixels"
    ):
        cameras_of(upright_only, tmp_path / "c.json")


def test_a_model_keeps_what_has_a_photograph(tmp_path, capsys, model):
    for image in model.images.values():
        image.name = f"images/{image.name}"
    loaded = load_model(write(model, tmp_path / "model"), photos_of(synthetic_model(CENTRES[:3])))
    assert sorted(i.name for i in loaded.images.values() if i.has_pose) == [
        "p0.png",
        "p1.png",
        "p2.png",
    ]
    assert "images/p3.png is not among the photographs; left out" in capsys.readouterr().err
    assert loaded.num_points3D() == 60


def test_a_model_of_other_photographs_is_refused(tmp_path, model):
    folder = write(model, tmp_path / "model")
    others = tuple(Photo(None, f"x{i}.png", 400, 300) for i in range(4))
    with pytest.raises(
        HandbenchError,
        match=r"holds 0 of the 4 photographs; expected at least 3, by the same names",
    ):
        load_model(folder, others)
    with pytest.raises(
        HandbenchError, match=r"p0\.png is 400 × 300 there, the photograph has 800 × 600"
    ):
        load_model(folder, photos_of(model, 800, 600))
    empty = write(synthetic_model(CENTRES, points=5), tmp_path / "empty")
    with pytest.raises(HandbenchError, match="holds 0 of the 4 photographs"):
        load_model(empty, photos_of(model))


def test_two_images_of_one_name_are_refused(tmp_path, model):
    for image in model.images.values():
        image.name = f"{image.name[1]}/a.png"
    with pytest.raises(HandbenchError, match=r"0/a\.png and 1/a\.png and .* may both be a\.png"):
        load_model(write(model, tmp_path / "model"), (Photo(None, "a.png", 400, 300),))


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin", "frames.bin"])
def test_a_broken_model_is_refused(tmp_path, model, file):
    folder = write(model, tmp_path / "model")
    (folder / file).write_bytes((folder / file).read_bytes()[:60])
    with pytest.raises(
        HandbenchError, match=r"is not readable as a COLMAP model|no sensible numbers"
    ):
        read_model(folder)
    (folder / "cameras.bin").unlink()
    with pytest.raises(HandbenchError, match="is not readable as a COLMAP model"):
        read_model(folder)
    with pytest.raises(HandbenchError, match="expected a folder with a COLMAP model"):
        read_model(folder / "images.bin")


@pytest.mark.parametrize(
    "params", [(440, 441, 201, 149, float("nan"), 0, 0, 0), (440, 441, 201, -9, 0, 0, 0, 0)]
)
def test_cameras_that_cannot_be_are_refused(tmp_path, model, params):
    model.cameras[1].params = params
    with pytest.raises(HandbenchError, match="no sensible numbers"):
        read_model(write(model, tmp_path / "model"))


def test_two_images_of_one_name_are_one_too_many(tmp_path, model):
    """By their names without folders; one image alone is taken, and so is the one whose whole name
    it is."""
    for image in model.images.values():
        image.name = {"p0.png": "l/a.png", "p1.png": "r/a.png"}.get(image.name, image.name)
    save_cameras(tmp_path / "c.json", cameras_in(model))
    with pytest.raises(
        HandbenchError, match=r"l/a\.png and r/a\.png may both be a\.png; rename one"
    ):
        cameras_of((Photo(None, "a.png", 400, 300),), tmp_path / "c.json")
    photos = tuple(Photo(None, name, 400, 300) for name in ("r/a.png", "p2.png"))
    found = cameras_of(photos, tmp_path / "c.json")
    np.testing.assert_allclose([camera.centre_m for camera in found], CENTRES[1:3], atol=1e-12)


@pytest.mark.parametrize(("points", "left"), [(19, False), (20, True)])
def test_a_photograph_of_a_model_sees_twenty_points(tmp_path, points, left):
    model = synthetic_model(CENTRES, points=points)
    folder = write(model, tmp_path / "model")
    if left:
        assert load_model(folder, photos_of(model)).num_reg_images() == 4
    else:
        with pytest.raises(HandbenchError, match="holds 0 of the 4 photographs"):
            load_model(folder, photos_of(model))


@pytest.mark.parametrize(
    ("focal_px", "k1", "fine"),
    [(41, 0, True), (39, 0, False), (7990, 0, True), (8010, 0, False), (440, 101, False)],
)
def test_a_lens_is_between_a_fisheyes_and_a_telescopes(tmp_path, model, focal_px, k1, fine):
    """Focal lengths of 0.1 to 20 times the picture's 400 pixels, distortion up to 100."""
    model.cameras[1].params = (focal_px, focal_px, 201, 149, k1, 0, 0, 0)
    folder = write(model, tmp_path / "model")
    if fine:
        assert read_model(folder).cameras[1].params[0] == focal_px
    else:
        with pytest.raises(HandbenchError, match="no sensible numbers"):
            read_model(folder)
