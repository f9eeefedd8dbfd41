"""Derivatives of pixels, against complex steps of a projection of our own."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handbench.groundtruth.cameras import load_pycolmap
from handbench.groundtruth.sparse.normal import pixel_jacobians, project
from tests.strategies import examples

STEP = 1e-30  # of a complex step, which has no rounding error
INTRINSICS = 8


def seen(params, x):
    """Pixels [n, 2] of points [n, 3] in the camera's frame: OPENCV's lens, as its manual has it."""
    fx, fy, cx, cy, k1, k2, p1, p2 = params
    a, b = x[:, 0] / x[:, 2], x[:, 1] / x[:, 2]
    r2 = a * a + b * b
    radial = 1 + k1 * r2 + k2 * r2 * r2
    u = a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a)
    v = b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b
    return np.stack([fx * u + cx, fy * v + cy], axis=1)


def image_of(params, R, t, model="OPENCV"):
    colmap = load_pycolmap()
    reconstruction = colmap.Reconstruction()
    reconstruction.add_camera_with_trivial_rig(
        colmap.Camera(camera_id=1, model=model, width=800, height=600, params=params)
    )
    pose = colmap.Rigid3d(colmap.Rotation3d(R), t)
    reconstruction.add_image_with_trivial_frame(colmap.Image("a.png", [], 1, 1), pose)
    return reconstruction, reconstruction.images[1]


def derivative(function, count, places):
    """Derivatives [n, 2, k] of function(v [count]) by v at `places`, where v = 0."""
    steps = 1j * STEP * np.eye(count)[list(places)]
    return np.stack([function(step).imag / STEP for step in steps], axis=-1)


@st.composite
def cameras(draw):
    """Params, R, t and points before the camera; millimetres from it to kilometres."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    f = draw(st.floats(100, 20_000))
    params = np.array(
        [f, f * random.uniform(0.9, 1.1), *random.uniform(100, 700, 2), *random.normal(0, 0.05, 4)]
    )
    R = Rotation.random(rng=random).as_matrix()
    reach = 10 ** draw(st.floats(-3, 3))
    x = random.uniform((-0.4, -0.4, 0.5), (0.4, 0.4, 1.5), (7, 3)) * reach
    t = random.normal(size=3) * reach
    return params, R, t, (x - t) @ R


@given(cameras())
@examples(25)
def test_derivatives_are_those_of_an_independent_projection(camera):
    params, R, t, points_m = camera
    _model, image = image_of(params, R, t)
    x = points_m @ R.T + t
    np.testing.assert_allclose(project(image, points_m), seen(params, x), rtol=1e-9)
    by_point, by_camera = pixel_jacobians(image, points_m, INTRINSICS)
    expected = (
        derivative(lambda d: seen(params, (points_m + d) @ R.T + t), 3, range(3)),
        derivative(lambda d: seen(params, x + d), 3, range(3)),
        derivative(lambda d: seen(params, x + np.cross(d, x)), 3, range(3)),
        derivative(lambda d: seen(params + d, x), 8, range(8)),
    )
    found = by_point, by_camera[..., :3], by_camera[..., 3:6], by_camera[..., 6:]
    for ours, theirs in zip(found, expected, strict=True):
        # pixels up to 2e4 are rounded to 4e-12: over twice a step of 1e-6 that is 2e-6, and 1e-8 of
        # the slopes by depth
        scale = np.abs(theirs).max()
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-7 * scale + 4e-6)
