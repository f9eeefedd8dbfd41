"""Cameras and models that others have made."""

import numpy as np
import pytest

from handbench.groundtruth.camera_files import cameras_in, cameras_of
from handbench.groundtruth.cameras import save_cameras
from handbench.groundtruth.photos import Photo
from tests.groundtruth.noisy_model import exact_model, photos_of
from tests.groundtruth.test_metashape import export
from tests.refusals import refuse

CENTRES = [(1.0, 0.1 * i, 0.2) for i in range(4)]


@pytest.fixture
def model():
    return exact_model(CENTRES)


@pytest.mark.parametrize("binary", [True, False])
def test_a_colmap_model_gives_lenses_and_poses(tmp_path, capsys, model, binary):
    """By names without folders; a photograph that it lacks has none. COLMAP cuts the names of a
    text at the first space."""
    for image in model.images.values():
        image.name = f"my images/{image.name}"
    (model.write_binary if binary else model.write_text)(tmp_path)
    photos = (*photos_of(exact_model(CENTRES)), Photo(None, "p9.png", 400, 300))
    cameras = cameras_of(photos, tmp_path)
    assert [camera.name for camera in cameras] == ["p0.png", "p1.png", "p2.png", "p3.png"]
    np.testing.assert_allclose([camera.centre_m for camera in cameras], CENTRES, atol=1e-12)
    assert cameras[0].params == tuple(model.cameras[1].params)
    assert "p9.png" in capsys.readouterr().err


def test_every_kind_of_file_names_the_photographs(tmp_path, model):
    save_cameras(tmp_path / "c.json", cameras_in(model))
    cameras = cameras_of(photos_of(model), tmp_path / "c.json")
    assert [camera.name for camera in cameras] == ["p0.png", "p1.png", "p2.png", "p3.png"]
    of_metashape = [Photo(None, f"DSC_{k}.JPG", 640, 480) for k in (1, 2)]
    cameras = cameras_of(of_metashape, export(tmp_path / "cams.xml"))
    assert [(camera.name, camera.posed) for camera in cameras] == [
        ("DSC_1.JPG", True),
        ("DSC_2.JPG", False),
    ]


def test_two_images_of_one_name_are_one_too_many(tmp_path, model):
    """By their names without folders; one image alone is taken, and so is the one whose whole name
    it is."""
    for image in model.images.values():
        image.name = {"p0.png": "l/a.png", "p1.png": "r/a.png"}.get(image.name, image.name)
    save_cameras(tmp_path / "c.json", cameras_in(model))

    def cameras(*names):
        return cameras_of([Photo(None, name, 400, 300) for name in names], tmp_path / "c.json")

    refuse(lambda: cameras("a.png"), "l/a.png and r/a.png")
    refuse(lambda: cameras("p9.png"), "c.json", "p9.png")
    found = cameras("r/a.png", "p2.png")
    np.testing.assert_allclose([camera.centre_m for camera in found], CENTRES[1:3], atol=1e-12)


def _wide(model, _):
    model.cameras[1].width = 800


def _lens(*params):
    def change(model, _):
        model.cameras[1].params = params

    return change


def _few(model, _):
    for image in (3, 4):
        model.deregister_frame(image)


def _without_cameras(model, folder):
    model.write_binary(folder)
    (folder / "cameras.bin").unlink()


def _latin(model, folder):
    model.write_binary(folder)
    file = folder / "images.bin"
    file.write_bytes(file.read_bytes().replace(b"p0.png", b"\xe40.png"))


def _cut(model, folder):
    """By 40 bytes, after which COLMAP's own reader does not return."""
    model.write_binary(folder)
    file = folder / "points3D.bin"
    file.write_bytes(file.read_bytes()[:-40])


@pytest.mark.parametrize(
    ("change", "places"),
    [
        (_wide, ("p0.png", "800 × 300")),
        (_few, ("2 of the 4",)),
        (_lens(440, 441, 201, 149, float("nan"), 0, 0, 0), ("p0.png", "'params.4' is nan")),
        (_lens(8010, 8010, 201, 149, 0, 0, 0, 0), ("p0.png",)),
        (_without_cameras, ("model",)),
        (_latin, ("model", "utf-8")),
        (_cut, ("points3D.bin",)),
    ],
)
def test_a_wrong_model_is_refused(tmp_path, model, change, places):
    """Also a focal length beyond 20 times the picture's 400 pixels."""
    folder = tmp_path / "model"
    folder.mkdir()
    change(model, folder)
    if not any(folder.iterdir()):
        model.write_binary(folder)
    refuse(lambda: cameras_of(photos_of(exact_model(CENTRES)), folder), *places)
