"""Photographs that would end in a wrong mesh or in none: said, left out or refused before the work starts."""

import cv2
import numpy as np
import pytest
from PIL import Image

from groundtruth.photos.photos import find_photos, look_at, usable
from groundtruth.sparse.frame import check_fit
from groundtruth.sparse.sparse import check_geometry, unregistered
from radar.support.errors import HandbenchError
from tests.groundtruth.room import around, look, photograph
from tests.groundtruth.synthetic_model import photos_of, synthetic_model


def names(photos):
    return [photo.name for photo in photos]


def test_good_photographs_pass_without_a_word(tmp_path, capsys):
    photograph(tmp_path)
    assert names(usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p2.png", "p3.png"]
    assert capsys.readouterr().err == ""


def test_repetitions_are_dropped(tmp_path, capsys):
    photograph(tmp_path)
    Image.open(tmp_path / "p1.png").save(tmp_path / "p9.tif")  # another file, the same pixels
    assert names(usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p2.png", "p3.png"]
    assert "p9.tif: the same pixels as p1.png; left out" in capsys.readouterr().err
    for i in (0, 2, 3):
        (tmp_path / f"p{i}.png").write_bytes((tmp_path / "p1.png").read_bytes())
    with pytest.raises(HandbenchError, match="only 1 photographs differ; at least 3 are needed"):
        usable(find_photos(tmp_path))


def blurred(path, kernel):
    cv2.imwrite(str(path), cv2.filter2D(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), -1, kernel))


@pytest.mark.parametrize("kind", ["defocus", "motion"])
def test_a_blurred_photograph_is_left_out_if_enough_remain(tmp_path, capsys, kind):
    photograph(tmp_path)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)) / 61.0
    blurred(tmp_path / "p2.png", disc if kind == "defocus" else np.eye(13) / 13)
    assert names(usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p3.png"]
    assert "p2.png: blurred (" in (said := capsys.readouterr().err) and "left out" in said
    (tmp_path / "p0.png").unlink()
    assert names(usable(find_photos(tmp_path))) == ["p1.png", "p2.png", "p3.png"]
    assert "used, since there are few" in capsys.readouterr().err


def test_sharpness_is_no_matter_of_contrast_and_plain_surfaces(tmp_path):
    photograph(tmp_path, 3)
    picture = np.asarray(Image.open(tmp_path / "p0.png"))
    Image.fromarray((60 + 0.4 * picture).astype(np.uint8)).save(tmp_path / "p1.png")
    Image.fromarray(np.pad(picture, 150, constant_values=200)).save(tmp_path / "p2.png")
    sharp, dim, framed = (look_at(photo).sharpness for photo in find_photos(tmp_path))
    assert dim == pytest.approx(sharp, rel=0.1) and framed == pytest.approx(sharp, rel=0.35)


def test_photographs_without_texture_are_refused(tmp_path):
    random = np.random.default_rng(0)
    for i in range(4):
        x, y = np.meshgrid(np.linspace(0, 1, 400), np.linspace(0, 1, 300))
        shaded = 120 + 60 * x * y + 10 * i + random.normal(0, 2, x.shape)
        Image.fromarray(shaded.astype(np.uint8)).save(tmp_path / f"p{i}.png")
    with pytest.raises(HandbenchError, match="0 of 4 photographs show enough texture"):
        usable(find_photos(tmp_path))
    for i in range(2):
        Image.fromarray(look(around(2)[i])).save(tmp_path / f"p{i}.png")
    with pytest.raises(HandbenchError, match="2 of 4 photographs show enough texture"):
        usable(find_photos(tmp_path))


def test_photographs_that_did_not_register_are_named(capsys):
    model = synthetic_model([(1, 0, 0.2), (1, 0.3, 0.2), (1, 0.6, 0.2)])
    assert unregistered(photos_of(model), model) == ()
    assert capsys.readouterr().err == ""
    model.deregister_frame(2)
    assert unregistered(photos_of(model), model) == ("p1.png",)
    assert "not registered, and not used: p1.png" in capsys.readouterr().err


def test_cameras_that_hardly_moved_are_refused():
    for baseline, fine in ((0.0, False), (0.01, False), (0.05, True)):
        model = synthetic_model([(1, baseline * i / 3, 0.2) for i in range(4)])
        if fine:
            check_geometry(model)
        else:
            with pytest.raises(HandbenchError, match=r"moved by \d\.\d\d% of the distance to the scene only, 3%"):
                check_geometry(model)


def test_a_model_without_points_is_refused():
    with pytest.raises(HandbenchError, match="moved by"):
        check_geometry(synthetic_model([(1, 0, 0.2), (1, 0.5, 0.2), (1, 1, 0.2)], points=0))


def test_a_scale_that_misses_its_own_numbers_is_refused():
    check_fit(1e-3, 0.4, "board corners")
    with pytest.raises(HandbenchError, match=r"board corners are 40\.0 mm off after the best fit, 10% of their extent"):
        check_fit(0.04, 0.4, "board corners")
