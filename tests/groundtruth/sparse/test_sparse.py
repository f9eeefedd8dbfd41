"""Photographs that do not register, and models without depth: reported or refused before the
work starts."""

import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.cameras.camera_files import cameras_in, write_model
from handbench.groundtruth.options import SparseOptions
from handbench.groundtruth.photos.photos import find_photos
from handbench.groundtruth.sparse.frame import apply
from handbench.groundtruth.sparse.inputs import SparseInputs
from handbench.groundtruth.sparse.sparse import check_geometry, register, warn_of_unregistered
from handbench.support.errors import HandbenchError
from tests.groundtruth.noisy_model import board_of, exact_model, noisy_model, photos_of


def test_photographs_that_did_not_register_are_named(capsys):
    model = exact_model([(1, 0, 0.2), (1, 0.3, 0.2), (1, 0.6, 0.2)])
    assert warn_of_unregistered(photos_of(model), model) == ()
    assert capsys.readouterr().err == ""
    model.deregister_frame(2)
    assert warn_of_unregistered(photos_of(model), model) == ("p1.png",)
    assert "could not be registered and are not used: p1.png" in capsys.readouterr().err


def test_cameras_that_hardly_moved_are_refused():
    """Or see no points."""
    for baseline, points in ((0.0, 60), (0.025, 60), (1.0, 0)):
        model = exact_model([(1, baseline * i / 3, 0.2) for i in range(4)], points)
        with pytest.raises(
            HandbenchError,
            match=r"moved by only \d\.\d\d% of the distance to the scene; expected at least 3%",
        ):
            check_geometry(model)
    check_geometry(exact_model([(1, 0.045 * i / 3, 0.2) for i in range(4)]))


@pytest.mark.parametrize("source", ["board", "model"])
def test_cameras_are_in_metres_by_what_gives_the_scale(tmp_path, source):
    """Of a COLMAP model in another frame and unit: the board; of a model in metres, nothing."""
    scene = noisy_model(noise=0, off=0, shared=True)
    true_m = np.array([camera.centre_m for camera in cameras_in(scene.model)])
    if source != "model":
        turned = 7.0 * np.array([(0, -1, 0), (0.6, 0, -0.8), (0.8, 0, 0.6)])
        apply(scene.model, np.block([[turned, np.array([[1.0], [2], [3]])], [np.zeros(3), 1]]))
    for camera in cameras_in(scene.model):
        Image.new("L", (camera.width, camera.height)).save(tmp_path / camera.name)
    (tmp_path / "model").mkdir()
    write_model(scene.model, tmp_path / "model")
    options, board, corners = SparseOptions(metric=source == "model"), None, {}
    if source == "board":
        board, corners = board_of(scene.corners_m), scene.corners
    photos = find_photos(tmp_path)
    found = register(SparseInputs(photos, None, board, corners, tmp_path / "model"), options)
    found_m = np.array([camera.centre_m for camera in found.cameras()])
    assert found.scale.source == source
    np.testing.assert_allclose(found_m, true_m, atol=1e-7)
