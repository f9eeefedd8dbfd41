"""Groups of photographs that share a camera, and what COLMAP is told about it."""

import numpy as np
import pytest
from PIL import Image

from groundtruth.cameras.cameras import Camera, load_pycolmap
from groundtruth.photos.photos import find_photos
from groundtruth.sparse.features import Lenses, find_features


def photographs(folder, models):
    for i, model in enumerate(models):
        exif = Image.Exif()
        if model:
            exif[0x0110] = model
        noise = np.random.default_rng(i).integers(0, 255, (120, 160), dtype=np.uint8)
        Image.fromarray(noise).save(folder / f"p{i}.jpg", exif=exif)
    return find_photos(folder)


def stored(database):
    """Photograph → camera id, and camera id → camera; ids of photographs must follow their names."""
    with load_pycolmap().Database.open(database) as content:
        images = sorted(content.read_all_images(), key=lambda image: image.name)
        cameras = {camera.camera_id: camera for camera in content.read_all_cameras()}
        return {image.name: image.camera_id for image in images}, cameras, [image.image_id for image in images]


@pytest.mark.parametrize(
    ("models", "shared", "count"),
    [("AABB", None, 2), ("AAAA", None, 1), ("AAB ", None, 3), ("    ", None, 1), ("AABB", True, 1), ("AAAA", False, 4)],
)
def test_photographs_of_one_body_share_a_camera(tmp_path, models, shared, count):
    photos = photographs(tmp_path, [model.strip() for model in models])
    find_features(photos, tmp_path / "database.db", Lenses(shared=shared))
    camera_of, cameras, ids = stored(tmp_path / "database.db")
    assert len(cameras) == len(set(camera_of.values())) == count
    assert ids == [1, 2, 3, 4]
    if count == 2:
        assert camera_of["p0.jpg"] == camera_of["p1.jpg"] != camera_of["p2.jpg"] == camera_of["p3.jpg"]


def test_known_intrinsics_reach_colmap(tmp_path):
    photos = photographs(tmp_path, ["A", "A", "A"])
    K = (200.1, 201.0, 80.0, 61.0)
    for free, rest in ((False, ()), (True, (0, 0, 0, 0))):
        find_features(photos, tmp_path / f"{free}.db", Lenses(intrinsics=K, free_distortion=free))
        _, cameras, _ = stored(tmp_path / f"{free}.db")
        assert [tuple(camera.params) for camera in cameras.values()] == [(*K, *rest)]
    known = {
        photo.name: Camera(name=photo.name, width=160, height=120, model="PINHOLE", params=(200 + i, 200, 80, 60))
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
