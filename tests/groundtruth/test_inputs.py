"""Inputs that the command accepts and refuses."""

import pytest
from PIL import Image

from handbench.cli.main import parser
from handbench.groundtruth.cameras import save_cameras
from handbench.groundtruth.options import Options
from handbench.groundtruth.photos import find_photos
from handbench.groundtruth.pipeline import perform
from handbench.groundtruth.sparse.inputs import Known, gather
from handbench.groundtruth.sparse.sfm import structure_from_motion
from handbench.support.config import parse
from tests.groundtruth.noisy_model import exact_model
from tests.groundtruth.room import around, look, photograph, true_camera
from tests.refusals import refuse

K = (440, 440, 200, 150)


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Photographs of two sizes."""
    folder = tmp_path_factory.mktemp("photos")
    photograph(folder)
    Image.fromarray(look(around(5)[4], size=(320, 240))).save(folder / "p4.png")
    return folder


def test_the_commands_arguments_reach_the_options():
    arguments = ["groundtruth", "photos", "-o", "a.ply", "--cameras", "m", "--box=-1,0,0,1,1,1"]
    chosen = vars(parser().parse_args([*arguments, "--metric"]))
    values = {name: value for name, value in chosen.items() if name in Options.model_fields}
    given = parse(Options, values, "groundtruth")
    assert given.metric and str(given.cameras) == "m" and given.box_m == (-1, 0, 0, 1, 1, 1)


@pytest.mark.parametrize(
    ("given", "place"),
    [
        ({"cameras": "m", "intrinsics": K}, "cameras, intrinsics"),
        ({}, "--unscaled"),
        ({"unscaled": True, "masks": "nowhere"}, "nowhere"),
        ({"unscaled": True, "box_m": (0, 0, 1, 1, 1, 0)}, "box_m"),
        ({"unscaled": True, "intrinsics": K}, "320 × 240, 400 × 300"),
    ],
)
def test_what_cannot_go_together_is_refused(tmp_path, photos, given, place):
    refuse(lambda: perform(tmp_path, photos, parse(Options, given, "test"), count=1), place)


def test_a_colmap_model_gives_the_scale_if_it_is_metric(tmp_path, photos):
    exact_model(around(4)).write_binary(tmp_path)
    assert gather(photos, Options(cameras=tmp_path, metric=True)).posed
    refuse(lambda: gather(photos, Options(cameras=tmp_path)), str(photos), "--metric")


@pytest.mark.parametrize(
    ("posed", "off_m", "place"), [(3, 9e3, None), (2, 0.0, "--unscaled"), (3, 1.1e4, "e+04 m")]
)
def test_the_poses_of_three_photographs_near_the_origin_give_the_scale(
    tmp_path, posed, off_m, place
):
    photograph(tmp_path)
    cameras = [true_camera(f"p{k}.png", centre_m) for k, centre_m in enumerate(around(4))]
    cameras = [
        c.model_copy(update={"t": (*c.t[:2], c.t[2] + off_m)} if k < posed else {"R": None})
        for k, c in enumerate(cameras)
    ]
    save_cameras(tmp_path / "cameras.json", tuple(cameras))
    if place:
        refuse(lambda: gather(tmp_path, Options()), place)
    else:
        assert sum(camera.posed for camera in gather(tmp_path, Options()).cameras) == posed


def test_photographs_without_overlap_are_refused(tmp_path):
    for i, centre_m in enumerate(around(3)):
        Image.fromarray(look(centre_m, size=(240, 180), room=i)).save(tmp_path / f"p{i}.png")
    known = Known(find_photos(tmp_path))
    refuse(lambda: structure_from_motion(known, tmp_path), "of 3 photographs")
