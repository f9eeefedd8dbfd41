"""Photographs that do not register, and models without depth: reported or refused before the
work starts."""

import numpy as np
import pytest

from handbench.groundtruth.camera_files import cameras_in
from handbench.groundtruth.options import SparseOptions
from handbench.groundtruth.sparse import sparse
from handbench.groundtruth.sparse.frame import Scale, apply
from handbench.groundtruth.sparse.inputs import Known
from handbench.groundtruth.sparse.sparse import Sparse, check_geometry, warn_of_unregistered
from handbench.support.errors import HandbenchError
from tests.groundtruth.noisy_model import PARAMS, board_of, exact_model, noisy_model, photos_of
from tests.refusals import refuse


def test_photographs_that_did_not_register_are_named(capsys):
    model = exact_model([(1, 0, 0.2), (1, 0.3, 0.2), (1, 0.6, 0.2)])
    warn_of_unregistered(photos_of(model), model)
    assert capsys.readouterr().err == ""
    model.deregister_frame(2)
    warn_of_unregistered(photos_of(model), model)
    printed = capsys.readouterr().err
    assert "p1.png" in printed and "p0.png" not in printed


def test_cameras_that_hardly_moved_are_refused():
    """Or see no points."""
    for baseline, points in ((0.0, 60), (0.025, 60), (1.0, 0)):
        model = exact_model([(1, baseline * i / 3, 0.2) for i in range(4)], points)
        refuse(lambda model=model: check_geometry(model), "photographs", "3%")
    check_geometry(exact_model([(1, 0.045 * i / 3, 0.2) for i in range(4)]))


@pytest.mark.parametrize(
    ("shared", "apart", "used"), [(1.02, 1.0, 1), (1.02, 1.018, 0), (1, 1, 0), (0, 1, 0)]
)
def test_photographs_get_lenses_of_their_own_where_the_board_says_so(
    monkeypatch, capsys, shared, apart, used
):
    """shared, apart: focal lengths that a registration finds, over the true one (0: it fails)."""
    scene, solved = noisy_model(noise=0, off=0), []
    known = Known(photos_of(scene.model), board=board_of(scene.corners_m), corners=scene.corners)

    def stand_in(_, lenses, seed):
        scale = {"auto": shared, "each": apart}[lenses]
        if not scale:
            raise HandbenchError("too few could be registered")
        model = noisy_model(noise=0, off=0, params=(scale * PARAMS[0], *PARAMS[1:])).model
        solved.append(Sparse(model, Scale("board"), None))
        return solved[-1]

    monkeypatch.setattr(sparse, "_solved", stand_in)
    assert sparse.register(known, SparseOptions()) is solved[used]
    assert len(solved) == 1 + (shared > 1)
    assert ("lenses: " in capsys.readouterr().err) == (shared != 1)


@pytest.mark.parametrize("source", ["board", "poses"])
def test_cameras_are_in_metres_by_what_gives_the_scale(monkeypatch, source):
    """Of given poses in another frame and unit: the board; of poses in metres, themselves."""
    scene, board, corners = noisy_model(noise=0, off=0, shared=True), None, {}
    true_m = np.array([camera.centre_m for camera in cameras_in(scene.model)])
    if source == "board":
        board, corners = board_of(scene.corners_m), scene.corners
        turned = 7.0 * np.array([(0, -1, 0), (0.6, 0, -0.8), (0.8, 0, 0.6)])
        apply(scene.model, np.block([[turned, np.array([[1.0], [2], [3]])], [np.zeros(3), 1]]))
    monkeypatch.setattr(sparse, "triangulate_known_poses", lambda *_: scene.model)
    photos, cameras = photos_of(scene.model), cameras_in(scene.model)
    known = Known(photos, cameras, source == "poses", board, corners)
    solved = sparse.register(known, SparseOptions())
    assert solved.scale.source == source
    found_m = np.array([camera.centre_m for camera in solved.cameras()])
    np.testing.assert_allclose(found_m, true_m, atol=1e-7)
