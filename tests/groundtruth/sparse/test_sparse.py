"""Photographs that do not register, and models without depth: reported or refused before the
work starts."""

import pytest

from handbench.groundtruth.sparse.sparse import check_geometry, warn_of_unregistered
from handbench.support.errors import HandbenchError
from tests.groundtruth.noisy_model import exact_model, photos_of


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
