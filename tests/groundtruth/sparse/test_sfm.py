"""Groups of photographs that share a camera, and what COLMAP gets to know of it."""

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from handbench.groundtruth.cameras.camera_files import cameras_in
from handbench.groundtruth.cameras.cameras import Camera, load_pycolmap
from handbench.groundtruth.photos.photos import Photo, find_photos
from handbench.groundtruth.sparse.sfm import (
    Lenses,
    describe_refinement,
    find_features,
    named_pictures,
    pipeline_options,
)
from tests.groundtruth.noisy_model import exact_model


def photographs(folder, models):
    for i, model in enumerate(models):
        exif = Image.Exif()
        exif[0x0110] = model
        noise = np.random.default_rng(i).integers(0, 255, (120, 160), dtype=np.uint8)
        Image.fromarray(noise).save(folder / f"p{i}.jpg", exif=exif)
    return find_photos(folder)


def test_photographs_of_one_body_share_a_camera_whose_focal_length_is_the_median(tmp_path):
    photos = photographs(tmp_path, "AAABB")
    focal_px = {"p0.jpg": 180.0, "p1.jpg": 190.0, "p2.jpg": 500.0}
    find_features(photos, tmp_path / "database.db", Lenses(focal_px=focal_px))
    with load_pycolmap().Database.open(tmp_path / "database.db") as content:
        images = {image.name: image for image in content.read_all_images()}
        cameras = {camera.camera_id: camera for camera in content.read_all_cameras()}
    a, *others = (images[f"p{i}.jpg"].camera_id for i in range(5))
    assert others[:2] == [a, a] and others[2] == others[3] != a and cameras[a].params[0] == 190.0
    # the ids follow the names
    assert [images[f"p{i}.jpg"].image_id for i in range(5)] == [1, 2, 3, 4, 5]


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
    assert not Lenses().known and not Lenses(intrinsics=K, free_distortion=True).known
    assert Lenses(cameras=(camera,)).known and Lenses(intrinsics=K).known


def test_cameras_that_moved_and_turned_are_compared():
    """By 0.3 m and 0.4 m off, one of them turned by 30° about its own axis of sight."""
    model = exact_model([(1.0, 0.0, 0.2), (1.0, 0.3, 0.2), (1.0, 0.3, 0.6)])
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    moved = []
    for camera, R, step_m in zip(
        cameras_in(model)[:2], (np.eye(3), turn), ((0.3, 0, 0), (0, 0, -0.4)), strict=True
    ):
        R = R @ camera.rotation
        pose = {"R": R.tolist(), "t": tuple(-R @ (camera.centre_m + step_m))}
        moved.append(camera.model_copy(update=pose))
    assert "moved by 0.35 (at most 0.4; " in describe_refinement(model, tuple(moved))
    assert "turned by 15° (at most 30°)" in describe_refinement(model, tuple(moved))


def test_colmap_finds_photographs_of_other_names_and_formats_under_their_names(tmp_path):
    """Pillow reads pictures by their content, so a PNG stands for a HEIC file."""
    colour = np.random.default_rng(0).integers(0, 255, (6, 8, 3), dtype=np.uint8)
    files = [tmp_path / "e\u0301.png", tmp_path / "b.heic"]  # é in two characters
    for file in files:
        Image.fromarray(colour).save(file, format="PNG")
    photos = tuple(
        Photo(file, name, 8, 6) for file, name in zip(files, ("é.png", "b.heic"), strict=True)
    )
    folder = named_pictures(photos, tmp_path)
    assert folder == named_pictures(photos, tmp_path) != tmp_path
    assert sorted(file.name for file in folder.iterdir()) == ["b.heic", "é.png"]
    for photo in photos:
        read = np.asarray(load_pycolmap().Bitmap.read(str(folder / photo.name), True).to_array())
        np.testing.assert_array_equal(read, colour)
