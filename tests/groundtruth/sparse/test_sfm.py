"""Groups of photographs that share a camera, and what COLMAP is told about it."""

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from handbench.groundtruth.cameras.camera_files import cameras_in
from handbench.groundtruth.cameras.cameras import Camera, load_pycolmap
from handbench.groundtruth.photos.photos import Photo, find_photos
from handbench.groundtruth.sparse.sfm import (
    Lenses,
    camera_changes,
    describe_refinement,
    find_features,
    pipeline_options,
)
from tests.groundtruth.synthetic_model import synthetic_model


def photographs(folder, models):
    for i, model in enumerate(models):
        exif = Image.Exif()
        if model:
            exif[0x0110] = model
        noise = np.random.default_rng(i).integers(0, 255, (120, 160), dtype=np.uint8)
        Image.fromarray(noise).save(folder / f"p{i}.jpg", exif=exif)
    return find_photos(folder)


def stored(database):
    """Photograph → camera id, and camera id → camera; ids of photographs must follow their
    names."""
    with load_pycolmap().Database.open(database) as content:
        images = sorted(content.read_all_images(), key=lambda image: image.name)
        cameras = {camera.camera_id: camera for camera in content.read_all_cameras()}
        return (
            {image.name: image.camera_id for image in images},
            cameras,
            [image.image_id for image in images],
        )


@pytest.mark.parametrize(
    ("models", "shared", "count"),
    [
        ("AABB", None, 2),
        ("AAAA", None, 1),
        ("AAB ", None, 3),
        ("    ", None, 1),
        ("AABB", True, 1),
        ("AAAA", False, 4),
    ],
)
def test_photographs_of_one_body_share_a_camera(tmp_path, models, shared, count):
    photos = photographs(tmp_path, [model.strip() for model in models])
    find_features(photos, tmp_path / "database.db", Lenses(shared=shared))
    camera_of, cameras, ids = stored(tmp_path / "database.db")
    assert len(cameras) == len(set(camera_of.values())) == count
    assert ids == [1, 2, 3, 4]
    if count == 2:
        assert (
            camera_of["p0.jpg"] == camera_of["p1.jpg"] != camera_of["p2.jpg"] == camera_of["p3.jpg"]
        )


def test_known_intrinsics_reach_colmap(tmp_path):
    photos = photographs(tmp_path, ["A", "A", "A"])
    K = (200.1, 201.0, 80.0, 61.0)
    for free, rest in ((False, ()), (True, (0, 0, 0, 0))):
        find_features(photos, tmp_path / f"{free}.db", Lenses(intrinsics=K, free_distortion=free))
        _, cameras, _ = stored(tmp_path / f"{free}.db")
        assert [tuple(camera.params) for camera in cameras.values()] == [(*K, *rest)]
    known = {
        photo.name: Camera(
            name=photo.name, width=160, height=120, model="PINHOLE", params=(200 + i, 200, 80, 60)
        )
        for i, photo in enumerate(photos)
    }
    find_features(photos, tmp_path / "each.db", Lenses(tuple(known.values())))
    camera_of, cameras, _ = stored(tmp_path / "each.db")
    for name, camera_id in camera_of.items():
        assert tuple(cameras[camera_id].params) == known[name].params
        assert cameras[camera_id].has_prior_focal_length


def test_focal_lengths_of_one_camera_are_pooled(tmp_path):
    photos = photographs(tmp_path, ["A", "A", "A"])
    focal_px = {"p0.jpg": 180.0, "p1.jpg": 190.0, "p2.jpg": 500.0}
    find_features(photos, tmp_path / "database.db", Lenses(focal_px=focal_px))
    _, cameras, _ = stored(tmp_path / "database.db")
    assert [camera.params[0] for camera in cameras.values()] == [190.0]


def test_the_same_seed_gives_the_same_model_without_colours_and_keeps_what_two_photographs_show():
    """COLMAP's own defaults differ: threads, random seeds, colours that nothing reads, tracks of
    two left out."""
    options = pipeline_options(7)
    assert (options.random_seed, options.mapper.random_seed, options.triangulation.random_seed) == (
        7,
        7,
        7,
    )
    assert options.num_threads == 1 and not options.extract_colors
    assert not options.triangulation.ignore_two_view_tracks


def test_what_is_known_of_lenses_decides_who_shares_a_camera():
    photos = tuple(
        Photo(None, name, width, 300, body=(body,))
        for name, width, body in zip("abcd", (400, 400, 400, 500), "xxyx", strict=True)
    )
    K = (440.0, 440.0, 200.0, 150.0)
    camera = Camera(name="a", width=400, height=300, model="PINHOLE", params=K)
    assert Lenses().groups(photos) == [["a", "b"], ["c"], ["d"]]
    assert Lenses(shared=True).groups(photos) == [["a", "b", "c"], ["d"]]
    assert (
        Lenses(shared=False).groups(photos)
        == Lenses(cameras=(camera,)).groups(photos)
        == [[n] for n in "abcd"]
    )
    assert Lenses(intrinsics=K, shared=False).groups(photos) == Lenses(intrinsics=K).groups(photos)
    assert Lenses(intrinsics=K).groups(photos) == [["a", "b", "c"], ["d"]]
    known = [
        Lenses(),
        Lenses(cameras=(camera,)),
        Lenses(intrinsics=K),
        Lenses(intrinsics=K, free_distortion=True),
    ]
    assert [lenses.known for lenses in known] == [False, True, True, False]


def test_cameras_that_moved_and_turned_are_told_by_how_much():
    """By 0.3 m and 0.4 m off, one of them turned by 30° about its own axis of sight."""
    model = synthetic_model([(1.0, 0.0, 0.2), (1.0, 0.3, 0.2), (1.0, 0.3, 0.6)])
    given = [camera for camera in cameras_in(model) if camera.name != "p2.png"]
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    moved = []
    for camera, R, step_m in zip(
        given, (np.eye(3), turn), ((0.3, 0, 0), (0, 0, -0.4)), strict=True
    ):
        R = R @ camera.rotation
        t = -R @ (camera.centre_m + step_m)
        moved.append(
            camera.model_copy(update={"R": tuple(map(tuple, R.tolist())), "t": tuple(t.tolist())})
        )
    distances, angles_rad = camera_changes(model, tuple(moved))
    np.testing.assert_allclose(distances, [0.3, 0.4], rtol=1e-9)
    np.testing.assert_allclose(np.degrees(angles_rad), [0, 30], atol=1e-5)
    assert "moved by 0.35 (at most 0.4; " in describe_refinement(model, tuple(moved))
    assert "turned by 15° (at most 30°)" in describe_refinement(model, tuple(moved))
