"""A COLMAP model without photographs: exact cameras and points."""

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.photos.photos import Photo

WIDTH, HEIGHT = 400, 300


def synthetic_model(centres, points=60):
    """A model whose cameras at `centres` [n, 3] look at points about the origin; all see all."""
    colmap = load_pycolmap()
    model = colmap.Reconstruction()
    random = np.random.default_rng(0)
    xyz = random.uniform(-0.2, 0.2, (points, 3))
    model.add_camera_with_trivial_rig(
        colmap.Camera(
            camera_id=1,
            model="OPENCV",
            width=WIDTH,
            height=HEIGHT,
            params=[440, 441, 201, 149, -0.05, 0.01, 1e-3, -1e-3],
        )
    )
    for i, centre in enumerate(np.asarray(centres, dtype=float)):
        R = Rotation.align_vectors([[0, 0, 1]], [-centre])[0].as_matrix()
        pose = colmap.Rigid3d(colmap.Rotation3d(R), -R @ centre)
        pixels = np.asarray(model.cameras[1].img_from_cam(pose * xyz))
        seen = [colmap.Point2D(pixel) for pixel in pixels]
        model.add_image_with_trivial_frame(colmap.Image(f"p{i}.png", seen, 1, i + 1), pose)
    for number, point in enumerate(xyz):
        track = colmap.Track([colmap.TrackElement(i + 1, number) for i in range(len(centres))])
        model.add_point3D(point, track, np.zeros(3, dtype=np.uint8))
    return model


def photos_of(model, width=WIDTH, height=HEIGHT):
    """Photographs of the model's names, without files."""
    names = sorted(image.name for image in model.images.values())
    return tuple(Photo(None, name, width, height) for name in names)
