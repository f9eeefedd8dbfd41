"""Derivatives of pixels in a photograph with respect to points and cameras."""

import numpy as np

from handbench.groundtruth.cameras.cameras import camera_in, pycolmap

# parameters of a pose: translation τ and rotation ω on the camera's side, x → x + τ + ω × x
POSE = 6
STEP = 1e-6  # of differences, relative


def project(image: "pycolmap.Image", points_m: np.ndarray) -> np.ndarray:
    """Project points [n, 3] of the model's frame to pixels [n, 2] of a photograph, in COLMAP's
    convention: the first pixel's centre is at (0.5, 0.5)."""
    return _pixels(camera_in(image), _in_camera(image, points_m))


def pixel_jacobians(
    image: "pycolmap.Image", points_m: np.ndarray, lens: int
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the derivatives of the pixels at which a photograph shows points [n, 3].

    Returns the derivatives with respect to the point [n, 2, 3], and those with respect to the
    camera [n, 2, 6 + lens]: translation and rotation of the pose, then the first `lens` of COLMAP's
    parameters. Derivatives of the projection are central differences.
    """
    camera, x = camera_in(image), _in_camera(image, points_m)
    by_x = np.empty((len(x), 2, 3))
    for axis in range(3):
        step = np.zeros_like(x)
        step[:, axis] = STEP * x[:, 2]
        by_x[..., axis] = (_pixels(camera, x + step) - _pixels(camera, x - step)) / (
            2 * step[:, axis, None]
        )
    by_camera = np.empty((len(x), 2, POSE + lens))
    by_camera[..., :3] = by_x
    by_camera[..., 3:6] = -np.cross(by_x, x[:, None, :])  # d(ω × x) = −[x]× dω
    for k in range(lens):
        step = STEP * max(abs(camera.params[k]), 1.0)
        ahead, behind = (_pixels(_moved(camera, k, s), x) for s in (step, -step))
        by_camera[..., POSE + k] = (ahead - behind) / (2 * step)
    return by_x @ image.cam_from_world().rotation.matrix(), by_camera


def _in_camera(image: "pycolmap.Image", points_m: np.ndarray) -> np.ndarray:
    pose = image.cam_from_world()
    return points_m @ pose.rotation.matrix().T + pose.translation


def _pixels(camera: "pycolmap.Camera", x: np.ndarray) -> np.ndarray:
    return np.asarray(camera.img_from_cam(x)).reshape(-1, 2)


def _moved(camera: "pycolmap.Camera", k: int, step: float) -> "pycolmap.Camera":
    """Return a copy of the camera whose intrinsic parameter number k is increased by step."""
    other = type(camera)(camera.todict())
    params = np.array(camera.params)
    params[k] += step
    other.params = params.tolist()
    return other
