"""Cameras and models that others have made."""

import numpy as np
import pytest

from handbench.groundtruth.cameras.camera_files import cameras_in, cameras_of
from handbench.groundtruth.cameras.cameras import save_cameras
from handbench.groundtruth.photos.photos import Photo
from handbench.support.errors import HandbenchError
from tests.groundtruth.cameras.test_metashape import export
from tests.groundtruth.noisy_model import exact_model, photos_of

CENTRES = [(1.0, 0.1 * i, 0.2) for i in range(4)]


@pytest.fixture
def model():
    return exact_model(CENTRES)


def write(model, folder, binary=True):
    folder.mkdir()
    (model.write_binary if binary else model.write_text)(folder)
    return folder


@pytest.mark.parametrize("binary", [True, False])
def test_a_colmap_model_gives_lenses_and_poses(tmp_path, capsys, model, binary):
    """By names without folders; a photograph that it lacks has none."""
    for image in model.images.values():
        image.name = f"images/{image.name}"
    folder = write(model, tmp_path / "model", binary)
    photos = (*photos_of(exact_model(CENTRES)), Photo(None, "p9.png", 400, 300))
    cameras = cameras_of(photos, folder)
    assert [camera.name for camera in cameras] == ["p0.png", "p1.png", "p2.png", "p3.png"]
    np.testing.assert_allclose([camera.centre_m for camera in cameras], CENTRES, atol=1e-12)
    assert cameras[0].params == tuple(model.cameras[1].params)
    assert "has no camera for the photograph p9.png" in capsys.readouterr().err


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


def test_two_images_of_one_name_are_one_too_many(tmp_path, model):
    """By their names without folders; one image alone is taken, and so is the one whose whole name
    it is."""
    for image in model.images.values():
        image.name = {"p0.png": "l/a.png", "p1.png": "r/a.png"}.get(image.name, image.name)
    save_cameras(tmp_path / "c.json", cameras_in(model))
    with pytest.raises(
        HandbenchError, match=r"l/a\.png and r/a\.png may both be the photograph a\.png; rename one"
    ):
        cameras_of((Photo(None, "a.png", 400, 300),), tmp_path / "c.json")
    photos = tuple(Photo(None, name, 400, 300) for name in ("r/a.png", "p2.png"))
    found = cameras_of(photos, tmp_path / "c.json")
    np.testing.assert_allclose([camera.centre_m for camera in found], CENTRES[1:3], atol=1e-12)


def _wide(model, folder):
    model.cameras[1].width = 800
    write(model, folder)


def _lens(*params):
    def change(model, folder):
        model.cameras[1].params = params
        write(model, folder)

    return change


def _cut(model, folder):
    """By 40 bytes, after which COLMAP's own reader does not return."""
    file = write(model, folder) / "points3D.bin"
    file.write_bytes(file.read_bytes()[:-40])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_wide, r"p0\.png is for 800 × 300 pixels, but the photograph has 400 × 300"),
        (
            lambda model, folder: (write(model, folder) / "cameras.bin").unlink(),
            "is not readable as a COLMAP model",
        ),
        (_cut, "the length of points3D.bin"),
        (lambda _, folder: write(exact_model(CENTRES[:2]), folder), "has cameras for 2 of the 4"),
        (_lens(440, 441, 201, 149, float("nan"), 0, 0, 0), "p0.png: 'params.4' is nan"),
        (_lens(8010, 8010, 201, 149, 0, 0, 0, 0), "impossible values"),
    ],
)
def test_a_wrong_model_is_refused(tmp_path, model, change, words):
    """Also a focal length beyond 20 times the picture's 400 pixels."""
    change(model, tmp_path / "model")
    with pytest.raises(HandbenchError, match=words):
        cameras_of(photos_of(exact_model(CENTRES)), tmp_path / "model")
