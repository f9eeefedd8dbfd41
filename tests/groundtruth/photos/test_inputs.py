"""Inputs that the command accepts and refuses."""

import pytest
from PIL import Image

from handbench.cli.groundtruth import _values
from handbench.cli.main import parser
from handbench.groundtruth.cameras.cameras import save_cameras
from handbench.groundtruth.options import Distance, Options
from handbench.groundtruth.photos.photos import find_photos
from handbench.groundtruth.sparse.inputs import gather, resolve
from handbench.groundtruth.sparse.sfm import Lenses, structure_from_motion
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from tests.groundtruth.noisy_model import exact_model
from tests.groundtruth.room import around, look, photograph, true_camera


def options_of(*arguments):
    chosen = parser().parse_args(["groundtruth", "photos", "-o", "out.ply", *arguments])
    return parse(Options, _values(chosen), "groundtruth")


def test_the_commands_arguments_reach_the_options():
    distances = ("--distance", "a.jpg,b.jpg,0.35", "--distance", "b.jpg, c.jpg, 0.5")
    given = options_of(*distances, "--model", "m", "--metric", "--box=-1,0,0,1,1,1")
    pairs = [tuple(distance.model_dump().values()) for distance in given.distances]
    assert pairs == [("a.jpg", "b.jpg", 0.35), ("b.jpg", "c.jpg", 0.5)]
    assert given.metric and str(given.model) == "m"
    assert given.box_m == (-1, 0, 0, 1, 1, 1)
    for text, words in (
        ("a,b", r"--distance: is 'a,b'; expected .*A\.jpg,B\.jpg,0\.350"),
        ("a,b,-1", r"distance_m.*greater than 0"),
    ):
        with pytest.raises(HandbenchError, match=words):
            options_of("--distance", text)


K = (440, 440, 200, 150)


def between(first, second):
    return {"distances": (Distance(first=first, second=second, distance_m=1),)}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"model": "m", "intrinsics": K}, "model, intrinsics: both are given, but"),
        ({"metric": True}, "metric: is only for a COLMAP model"),
        (
            between("p0.png", "p7.png"),
            r"distances: p7\.png is not one of the photographs used; did",
        ),
        ({}, r"nothing gives the scale.*unscaled=True"),
        ({"model": "m"}, "nothing gives the scale.*metric=True"),
        ({"unscaled": True, "masks": "nowhere"}, "expected a folder with masks"),
        ({"unscaled": True, "box_m": (0, 0, 1, 1, 1, 0)}, "box_m"),
        ({"unscaled": True, "refine_distortion": True}, "refine_distortion: needs intrinsics"),
        ({"unscaled": True, "refine_poses": True}, "refine_poses: needs a pose"),
        ({"unscaled": True, "intrinsics": K}, r"different sizes \(320 × 240, 400 × 300\)"),
    ],
)
def test_what_cannot_go_together_is_refused(tmp_path, given, words):
    """One of the photographs has another size."""
    photograph(tmp_path)
    Image.fromarray(look(around(5)[4], size=(320, 240))).save(tmp_path / "p4.png")
    with pytest.raises(HandbenchError, match=words):
        gather(tmp_path, resolve(tmp_path, parse(Options, given, "test"))[1])


def test_a_distance_or_a_metric_model_is_enough(tmp_path):
    photograph(tmp_path)
    folder = tmp_path / "model"
    folder.mkdir()
    exact_model(around(4)).write_binary(folder)
    assert gather(tmp_path, Options(**between("p0.png", "p1.png")))[0].model is None
    by_model, _ = gather(tmp_path, Options(model=folder, metric=True))
    by_poses, _ = gather(tmp_path, Options(cameras=folder, metric=True))
    assert by_model.model == folder and by_poses.posed
    with pytest.raises(HandbenchError, match="nothing gives the scale"):
        gather(tmp_path, Options(cameras=folder))  # COLMAP's poses have no unit


def test_the_poses_of_three_photographs_give_the_scale(tmp_path):
    photograph(tmp_path)
    cameras = [true_camera(f"p{k}.png", centre_m) for k, centre_m in enumerate(around(4))]
    cameras[3] = cameras[3].model_copy(update={"R": None, "t": None})
    save_cameras(tmp_path / "cameras.json", tuple(cameras))
    found, _ = gather(tmp_path, Options())
    assert [camera.posed for camera in found.cameras] == [True] * 3 + [False]
    cameras[2] = cameras[2].model_copy(update={"R": None, "t": None})
    save_cameras(tmp_path / "cameras.json", tuple(cameras))
    with pytest.raises(HandbenchError, match="nothing gives the scale"):
        gather(tmp_path, Options())


def test_photographs_without_overlap_end_in_a_sentence(tmp_path):
    for i, centre_m in enumerate(around(4)):
        Image.fromarray(look(centre_m, room=i)).save(tmp_path / f"p{i}.png")
    (tmp_path / "sfm").mkdir()
    with pytest.raises(
        HandbenchError, match="of 4 photographs could be registered; expected at least 3"
    ):
        structure_from_motion(find_photos(tmp_path), tmp_path / "sfm", Lenses())
