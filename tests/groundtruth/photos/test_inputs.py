"""Inputs that the command accepts and refuses before the work starts; and hard photographs,
registered."""

import cv2
import numpy as np
import pytest
from PIL import Image

from handbench.cli.groundtruth import _values
from handbench.cli.main import parser
from handbench.groundtruth.cameras.cameras import Camera, save_cameras
from handbench.groundtruth.options import Distance, Options
from handbench.groundtruth.photos.photos import find_photos
from handbench.groundtruth.sparse.inputs import content, gather, resolve
from handbench.groundtruth.sparse.sfm import Lenses, structure_from_motion
from handbench.groundtruth.sparse.sparse import check_geometry, warn_of_unregistered
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash
from tests.groundtruth.room import around, camera_rotation, look, photograph
from tests.groundtruth.synthetic_model import synthetic_model


def options_of(*arguments):
    chosen = parser().parse_args(["groundtruth", "photos", "-o", "out.ply", *arguments])
    return parse(Options, _values(chosen), "groundtruth")


def test_the_commands_arguments_reach_the_options():
    distances = ("--distance", "a.jpg,b.jpg,0.35", "--distance", "b.jpg, c.jpg, 0.5")
    given = options_of(*distances, "--model", "m", "--metric")
    pairs = [tuple(distance.model_dump().values()) for distance in given.distances]
    assert pairs == [("a.jpg", "b.jpg", 0.35), ("b.jpg", "c.jpg", 0.5)]
    assert given.metric and str(given.model) == "m" and given.mask == "none"
    assert options_of("--mask", "colour", "--masks", "x", "--box=-1,0,0,1,1,1").box_m == (
        -1,
        0,
        0,
        1,
        1,
        1,
    )
    with pytest.raises(
        HandbenchError, match=r"--distance: is 'a,b'; expected A\.jpg,B\.jpg,0\.350"
    ):
        options_of("--distance", "a,b")
    with pytest.raises(HandbenchError, match=r"distance_m.*greater than 0"):
        options_of("--distance", "a,b,-1")


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        (
            {"model": "m", "intrinsics": (1, 1, 1, 1)},
            "model and intrinsics: both are given; the model has its own",
        ),
        (
            {"board": "b", "distances": [("p0.png", "p1.png", 1)]},
            "board and distances: both are given",
        ),
        ({"masks": "m", "mask": "colour"}, "masks and mask: both are given"),
        ({"metric": True}, "metric: there is no COLMAP model"),
        (
            {"distances": [("p0.png", "p7.png", 1)]},
            r"distances: p7\.png is none of the photographs used; did you mean",
        ),
        ({"model": "m"}, "nothing gives the scale.*--metric"),
        ({"unscaled": True, "masks": "nowhere"}, "expected a folder with masks"),
    ],
)
def test_what_cannot_go_together_is_refused(tmp_path, given, complaint):
    photograph(tmp_path)
    if "distances" in given:
        pairs = [
            Distance(first=a, second=b, distance_m=metres) for a, b, metres in given["distances"]
        ]
        given = given | {"distances": tuple(pairs)}
    with pytest.raises(HandbenchError, match=complaint):
        gather(tmp_path, resolve(tmp_path, parse(Options, given, "test"))[1])


def test_one_camera_cannot_have_two_sizes(tmp_path):
    photograph(tmp_path)
    Image.fromarray(look(around(5)[4], size=(320, 240))).save(tmp_path / "p4.png")
    with pytest.raises(
        HandbenchError, match=r"intrinsics: .* different sizes \(320 × 240, 400 × 300\)"
    ):
        gather(tmp_path, Options(intrinsics=(440, 440, 200, 150), unscaled=True))


def test_every_scale_is_enough(tmp_path):
    photograph(tmp_path)
    distance = Distance(first="p0.png", second="p1.png", distance_m=0.3)
    folder = tmp_path / "model"
    folder.mkdir()
    synthetic_model(around(4)).write_binary(folder)
    assert gather(tmp_path, Options(distances=(distance,)))[0].model is None
    by_model, _ = gather(tmp_path, Options(model=folder, metric=True))
    by_poses, _ = gather(tmp_path, Options(cameras=folder, metric=True))
    assert by_model.model == folder and all(camera.R is not None for camera in by_poses.cameras)
    given = (Options(model=folder, metric=True), Options(cameras=folder, metric=True))
    assert len({content_hash(*content(by_model.photos, options)) for options in given}) == 2
    with pytest.raises(HandbenchError, match="nothing gives the scale"):
        gather(tmp_path, Options(cameras=folder))  # COLMAP's poses have no unit


@pytest.mark.parametrize(("posed", "enough"), [(4, True), (3, True), (2, False)])
def test_the_poses_of_three_photographs_give_the_scale(tmp_path, posed, enough):
    photograph(tmp_path)
    lens = {"width": 400, "height": 300, "params": (440, 440, 200, 150, 0, 0, 0, 0)}
    placed = []
    for k, centre_m in enumerate(around(4)):
        R = camera_rotation(-np.array(centre_m))
        pose = (
            {"R": tuple(map(tuple, R.tolist())), "t": tuple((-R @ centre_m).tolist())}
            if k < posed
            else {}
        )
        placed.append(Camera(name=f"p{k}.png", **lens, **pose))
    save_cameras(tmp_path / "cameras.json", tuple(placed))
    if not enough:
        with pytest.raises(HandbenchError, match="nothing gives the scale"):
            gather(tmp_path, Options(cameras=tmp_path / "cameras.json"))
        return
    found, _ = gather(tmp_path, Options(cameras=tmp_path / "cameras.json"))
    assert sum(camera.posed for camera in found.cameras) == posed


def solve(folder):
    (folder / "sfm").mkdir()
    photos = find_photos(folder)
    return photos, structure_from_motion(photos, folder / "sfm", Lenses())


def test_hard_photographs_register_and_a_stranger_is_named(tmp_path, capsys):
    """A CMYK file, one of 16 bits, one of half the size, one turned by 90°, one of another room."""
    centres = around(6)
    for i, centre_m in enumerate(centres[:5]):
        picture = look(centre_m, size=(200, 150) if i == 2 else (400, 300))
        if i == 0:
            Image.fromarray(picture).convert("RGB").convert("CMYK").save(
                tmp_path / "p0.jpg", quality=97
            )
        else:
            picture = np.rot90(picture) if i == 3 else picture
            cv2.imwrite(
                str(tmp_path / f"p{i}.png"), picture.astype(np.uint16) * 257 if i == 1 else picture
            )
    Image.fromarray(look(centres[5], room=1)).save(tmp_path / "x.png")
    photos, model = solve(tmp_path)
    assert warn_of_unregistered(photos, model) == ("x.png",)
    assert "not registered, and not used: x.png" in capsys.readouterr().err
    check_geometry(model)
    found = {image.name: image.projection_center() for image in model.images.values()}
    ends, true_ends = (
        np.linalg.norm(c[4] - c[0]) for c in (list(found[n] for n in sorted(found)), centres)
    )
    for i, name in enumerate(sorted(found)):
        there = np.linalg.norm(found[name] - found["p0.jpg"]) / ends
        assert there == pytest.approx(np.linalg.norm(centres[i] - centres[0]) / true_ends, abs=0.03)


@pytest.mark.parametrize("case", ["turned on the spot", "no overlap"])
def test_photographs_without_depth_end_in_a_sentence(tmp_path, case):
    for i in range(4):
        if case == "no overlap":
            picture = look(around(4)[i], room=i)
        else:
            picture = look(around(1)[0], towards_m=(0.12 * i - 0.2, 0.2 - 0.12 * i, 0.02 * i))
        Image.fromarray(picture).save(tmp_path / f"p{i}.png")
    with pytest.raises(HandbenchError, match=r"could be registered|the cameras moved by"):
        check_geometry(solve(tmp_path)[1])
