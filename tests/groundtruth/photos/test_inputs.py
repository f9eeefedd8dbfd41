"""Inputs that the command accepts and refuses."""

from contextlib import nullcontext

import pytest
from PIL import Image

from handbench.cli.main import parser
from handbench.groundtruth.cameras.cameras import save_cameras
from handbench.groundtruth.options import Options
from handbench.groundtruth.photos.photos import find_photos
from handbench.groundtruth.pipeline import perform
from handbench.groundtruth.sparse.inputs import Known, gather
from handbench.groundtruth.sparse.sfm import structure_from_motion
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from tests.groundtruth.noisy_model import exact_model
from tests.groundtruth.room import around, look, photograph, true_camera


def options_of(*arguments):
    chosen = parser().parse_args(["groundtruth", "photos", "-o", "out.ply", *arguments])
    values = {name: value for name, value in vars(chosen).items() if name in Options.model_fields}
    return parse(Options, values, "groundtruth")


def test_the_commands_arguments_reach_the_options():
    given = options_of("--cameras", "m", "--metric", "--box=-1,0,0,1,1,1")
    assert given.metric and str(given.cameras) == "m"
    assert given.box_m == (-1, 0, 0, 1, 1, 1)


K = (440, 440, 200, 150)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"cameras": "m", "intrinsics": K}, "cameras, intrinsics: both are given"),
        ({}, r"nothing gives the scale.*--unscaled"),
        ({"unscaled": True, "masks": "nowhere"}, "expected a folder with masks"),
        ({"unscaled": True, "box_m": (0, 0, 1, 1, 1, 0)}, "box_m"),
        ({"unscaled": True, "intrinsics": K}, r"different sizes \(320 × 240, 400 × 300\)"),
    ],
)
def test_what_cannot_go_together_is_refused(tmp_path, given, words):
    """One of the photographs has another size."""
    photograph(tmp_path)
    Image.fromarray(look(around(5)[4], size=(320, 240))).save(tmp_path / "p4.png")
    with pytest.raises(HandbenchError, match=words):
        perform(tmp_path / "work", tmp_path, parse(Options, given, "test"), count=1)


def test_a_metric_model_is_enough(tmp_path):
    photograph(tmp_path)
    folder = tmp_path / "model"
    folder.mkdir()
    exact_model(around(4)).write_binary(folder)
    assert gather(tmp_path, Options(cameras=folder, metric=True)).posed
    with pytest.raises(HandbenchError, match="nothing gives the scale"):
        gather(tmp_path, Options(cameras=folder))  # COLMAP's poses have no unit


def test_the_poses_of_three_photographs_give_the_scale(tmp_path):
    photograph(tmp_path)
    cameras = [true_camera(f"p{k}.png", centre_m) for k, centre_m in enumerate(around(4))]
    cameras[3] = cameras[3].model_copy(update={"R": None, "t": None})
    save_cameras(tmp_path / "cameras.json", tuple(cameras))
    found = gather(tmp_path, Options())
    assert [camera.posed for camera in found.cameras] == [True] * 3 + [False]
    cameras[2] = cameras[2].model_copy(update={"R": None, "t": None})
    save_cameras(tmp_path / "cameras.json", tuple(cameras))
    with pytest.raises(HandbenchError, match="nothing gives the scale"):
        gather(tmp_path, Options())


def test_cameras_far_from_the_origin_are_refused(tmp_path):
    photograph(tmp_path)
    cameras = [true_camera(f"p{k}.png", centre_m) for k, centre_m in enumerate(around(4))]
    for off_m, refused in ((9e3, False), (1.1e4, True)):
        moved = [c.model_copy(update={"t": (*c.t[:2], c.t[2] + off_m)}) for c in cameras]
        save_cameras(tmp_path / "cameras.json", tuple(moved))
        with pytest.raises(HandbenchError, match="subtract") if refused else nullcontext():
            gather(tmp_path, Options())


def test_photographs_without_overlap_end_in_a_sentence(tmp_path):
    for i, centre_m in enumerate(around(4)):
        Image.fromarray(look(centre_m, room=i)).save(tmp_path / f"p{i}.png")
    (tmp_path / "sfm").mkdir()
    with pytest.raises(
        HandbenchError, match="of 4 photographs could be registered; expected at least 3"
    ):
        structure_from_motion(Known(find_photos(tmp_path)), tmp_path / "sfm")
