"""Groups of photographs that share a camera, and what COLMAP gets to know of it."""

import numpy as np
from PIL import Image

from handbench.groundtruth.cameras.cameras import Camera, load_pycolmap
from handbench.groundtruth.photos.photos import Photo, find_photos
from handbench.groundtruth.sparse.sfm import Lenses, find_features, named_pictures


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
    assert not Lenses().known and Lenses(cameras=(camera,)).known and Lenses(intrinsics=K).known


def test_colmap_finds_photographs_of_other_names_and_tones_under_their_names(tmp_path):
    gray = np.random.default_rng(0).integers(0, 255, (6, 8), dtype=np.uint8)
    files = [tmp_path / "e\u0301.png", tmp_path / "b.png"]  # é in two characters
    for file in files:
        Image.fromarray(gray).save(file)
    photos = (Photo(files[0], "é.png", 8, 6), Photo(files[1], "b.png", 8, 6, tones=(0, 0.5)))
    folder = named_pictures(photos, tmp_path)
    assert folder == named_pictures(photos, tmp_path) != tmp_path
    assert sorted(file.name for file in folder.iterdir()) == ["b.png", "é.png"]
    for photo in photos:
        read = np.asarray(load_pycolmap().Bitmap.read(str(folder / photo.name), False).to_array())
        np.testing.assert_allclose(read, 255 * photo.gray(), atol=0.51)
