"""Effects of the lens in photographs: defocus by a finite aperture, and blur."""

from dataclasses import dataclass

import numpy as np

from handbench.groundtruth.cameras.cameras import Camera

LEVEL_STEP = np.sqrt(2)  # ratio of neighbouring diameters in the stack of blurred pictures
KERNEL_SAMPLES = 8  # per pixel and direction, at least


@dataclass(frozen=True)
class ThinLens:
    """A thin lens. aperture_m: diameter of its aperture. focus_m: distance of the plane in focus.
    image_px: distance from lens to sensor in pixels (the camera's calibrated focal length)."""

    aperture_m: float
    focus_m: float
    image_px: float

    @classmethod
    def of(
        cls, camera: Camera, f_number: float, sensor_width_m: float, focus_m: float
    ) -> "ThinLens":
        """Return the thin lens of a camera that focuses at focus_m.

        The sensor is at the distance v behind the lens with 1/f = 1/v + 1/focus_m, and the aperture
        is f over f_number (Hecht, Optics, 5.2). sensor_width_m: width of the sensor, which converts
        the camera's pixels to metres.
        """
        image_px = camera.params[0]
        image_m = image_px * sensor_width_m / camera.width
        focal_m = image_m * focus_m / (image_m + focus_m)
        return cls(focal_m / f_number, focus_m, image_px)

    def circle_px(self, depth_m: np.ndarray) -> np.ndarray:
        """Compute the diameter in pixels [...] of the circle of confusion of points at depth_m
        [...] along the optical axis: A v |1/focus − 1/depth| with aperture A and sensor distance
        v."""
        return self.aperture_m * self.image_px * np.abs(1 / self.focus_m - 1 / depth_m)

    def rays(
        self, camera: Camera, directions: np.ndarray, u: float, v: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute the rays of pixels through one point (u, v) of the aperture, in units of the
        aperture's radius.

        directions [n, 3]: unit directions of the pixels' rays through the aperture's centre.
        Returns the starting point [3] and unit directions [n, 3]. The rays of one pixel meet in the
        plane in focus (Cook, Porter & Carpenter 1984).
        """
        right, down, forward = camera.rotation
        shift_m = self.aperture_m / 2 * (u * right + v * down)
        rays = directions * (self.focus_m / (directions @ forward))[:, None] - shift_m
        return camera.centre_m + shift_m, rays / np.linalg.norm(rays, axis=1, keepdims=True)


def blur_by_discs(image: np.ndarray, diameter_px: np.ndarray) -> np.ndarray:
    """Blur an image [height, width, 3]: each pixel becomes the mean over a disc with its own
    diameter, diameter_px [height, width].

    The whole image is blurred with a few fixed diameters. For any other diameter, two of these
    images are mixed so that the variance of the blur, which grows with the diameter squared, is
    right.
    """
    import cv2

    count = 1 + int(np.ceil(np.log(max(diameter_px.max(), 1)) / np.log(LEVEL_STEP)))
    levels = np.concatenate([[0], LEVEL_STEP ** np.arange(count)])  # the sharp picture first
    result = np.zeros_like(image)
    for level, chosen in zip(levels, np.eye(len(levels)), strict=True):
        weight = np.interp(diameter_px**2, levels**2, chosen).astype(np.float32)
        result += weight[..., None] * (
            cv2.filter2D(image, -1, disc_kernel(level)) if level else image
        )
    return result


def near_edges(edge: np.ndarray, radius_px: np.ndarray) -> np.ndarray:
    """Return the mask [height, width] of the pixels whose blur may reach across an edge.

    edge [height, width]: mask of the pixels at an edge. A pixel is marked if its distance to an
    edge pixel is at most the blur's radius at that edge pixel: the largest of radius_px [height,
    width] in its neighbourhood, rounded up to a power of two. Radii up to 0.5 count as no blur.
    """
    import cv2

    reach_px = np.where(
        edge, cv2.dilate(radius_px.astype(np.float32), np.ones((3, 3), np.uint8)), 0
    )
    result = np.zeros(edge.shape, dtype=bool)
    lower_px, upper_px = 0.5, 1.0
    while (reach_px > lower_px).any():
        source = (reach_px > lower_px) & (reach_px <= upper_px)
        if source.any():
            result |= cv2.distanceTransform((~source).astype(np.uint8), cv2.DIST_L2, 5) <= upper_px
        lower_px, upper_px = upper_px, 2 * upper_px
    return result


def disc_kernel(diameter_px: float) -> np.ndarray:
    """Return the weights [n, n], with sum 1, of a filter that averages over a disc."""
    along = _along(diameter_px)
    x, y = np.meshgrid(along, along)
    inside = x**2 + y**2 <= (diameter_px / 2) ** 2
    return _kernel(x[inside], y[inside])


def line_kernel(length_px: float, angle_rad: float) -> np.ndarray:
    """Return the weights [n, n], with sum 1, of a filter that averages along a line through the
    middle pixel, as motion blur does. angle_rad: direction of the line, from the image's x axis
    towards its y axis."""
    along = _along(length_px)
    return _kernel(along * np.cos(angle_rad), along * np.sin(angle_rad))


def _along(length_px: float) -> np.ndarray:
    """Return evenly spaced coordinates [n] from −length_px/2 to length_px/2: about 8 per pixel and
    at least 64."""
    count = max(64, int(KERNEL_SAMPLES * length_px))
    return ((np.arange(count) + 0.5) / count - 0.5) * length_px


def _kernel(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the weights [n, n], with sum 1, of a filter that averages over the points x, y (pixels
    from the middle). Each point is distributed over the 16 pixels around it with cubic weights,
    which keep the mean and the variance of the points (Keys 1981)."""
    half = int(np.ceil(max(np.abs(x).max(), np.abs(y).max()))) + 2
    result = np.zeros((2 * half + 1, 2 * half + 1))
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    for dc in range(-1, 3):
        for dr in range(-1, 3):
            np.add.at(
                result,
                (row + dr + half, column + dc + half),
                _cubic(row + dr - y) * _cubic(column + dc - x),
            )
    return (result / result.sum()).astype(np.float32)


def _cubic(t: np.ndarray) -> np.ndarray:
    t = np.abs(t)
    return np.where(
        t <= 1,
        1.5 * t**3 - 2.5 * t**2 + 1,
        np.where(t < 2, -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2, 0),
    )
