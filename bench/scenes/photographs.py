"""Simulated photographs of a scene, by ray casting, with blur and the sensor's noise."""

import itertools

import numpy as np

from handbench.bench.scenes.bodies import bake, bodies, lit_print
from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.scene_file import Photos
from handbench.bench.scenes.stand import PLATE_BOX_M, PLATE_M, TEXEL_M, cuboid
from handbench.groundtruth.cameras import Camera
from handbench.radar.simulation.scene import Choice
from handbench.support.compiled import FAST, njit
from handbench.support.rays import load_open3d

ROOM = 0.03  # radiance of the dark room behind the stand
EDGE_STEP_M = 1.5e-3  # neighbouring pixels whose depth differs by more see an edge between them
APART_M = 1.0  # added to the depths of each next body, so that an edge lies between them
ROWS = 32  # photographed at a time: what they need on the way stays in the cache
UNDISTORTIONS = 5  # leave 1e-6 px
EDGES = 8192  # pixels at edges, photographed at a time
EDGE_SAMPLES = 3  # sub-pixels per direction at an edge
NOISE = 3  # seed of the noise's generator, with the scene's and the photograph's


def photo_effects(photos: Photos) -> tuple[Choice, ...]:
    """Return one row for each effect of photographs: whether it is on, and why."""
    blurred = photos.blur_px > 0
    why = "named in [photos]"
    return (
        Choice(effect="photos.blur", on=blurred, why=why if blurred else "needs photos.blur_px"),
        Choice(effect="photos.noise", on=True, why=why),
    )


class Studio:
    """A lit scene, ready to be photographed: its bodies with the light on them, and a ray caster.
    Making one takes long, since lamps and shadows are computed for every vertex."""

    def __init__(self, scene: Scene) -> None:
        assert scene.file.photos is not None  # as there are cameras
        self.photos, self.seed = scene.file.photos, scene.file.seed
        self.bodies = bodies(scene)
        self.rays = load_open3d().t.geometry.RaycastingScene()
        plate_m, (*_, lower, upper) = cuboid(PLATE_BOX_M, step_m=1.0)  # of its front, the last
        surfaces = [(body.vertices_m, body.faces) for body in self.bodies]
        for vertices_m, faces in (*surfaces, (plate_m, np.stack([lower, upper]))):
            self.rays.add_triangles(vertices_m.astype(np.float32), faces.astype(np.uint32))
        self.light = [bake(self.rays, body.vertices_m, body.normals) for body in self.bodies]
        self.front = lit_print(scene, self.rays)

    def photograph(self, camera: Camera, number: int) -> np.ndarray:
        """Take one photograph. Returns uint8 [height, width, 3] in OpenCV's order blue, green, red.
        number: seed of the photograph's noise."""
        import cv2

        radiance, blur_px = self.expose(camera), self.photos.blur_px
        if blur_px > 0:
            radiance = cv2.GaussianBlur(radiance, (0, 0), blur_px)
        return self._develop(radiance, number)[..., ::-1]

    def _develop(self, radiance: np.ndarray, number: int) -> np.ndarray:
        """Convert radiance [height, width, 3], with 1 for white, to 8-bit sRGB [height, width, 3],
        with noise. number: of the photograph; with the scene's seed, it determines the noise."""
        random = np.random.default_rng([self.seed, NOISE, number])
        electron = 1 / self.photos.full_well_e
        read_noise = electron * self.photos.read_noise_e
        tones, result = _tones(), np.empty(radiance.shape, np.uint8)
        for top in range(0, len(radiance), ROWS):
            light = np.maximum(radiance[top : top + ROWS], 0)
            noise = random.standard_normal(light.shape, dtype=np.float32)
            light += noise * np.sqrt(electron * light + read_noise**2)
            np.clip(light, 0, 1, out=light)
            result[top : top + ROWS] = tones[np.rint(light * (len(tones) - 1)).astype(np.uint16)]
        return result

    def expose(self, camera: Camera) -> np.ndarray:
        """Compute the light on a camera's pixels, float32 [height, width, 3] in RGB with 1 for
        white, without blur and noise. Pixels at edges are means of several rays."""
        near = np.any([body.near(camera) for body in self.bodies], axis=0)
        parts = [
            self.shoot(camera, _centres(camera, top), near[top : top + ROWS])
            for top in range(0, camera.height, ROWS)
        ]
        radiance, depth_m = map(np.concatenate, zip(*parts, strict=True))
        edges = np.argwhere(_edges(depth_m))
        offsets = (np.arange(EDGE_SAMPLES) + 0.5) / EDGE_SAMPLES
        within = np.array(list(itertools.product(offsets, repeat=2)), np.float32)
        for first in range(0, len(edges), EDGES):
            row, column = edges[first : first + EDGES].T
            pixels = np.stack([column, row], axis=1, dtype=np.float32)[:, None] + within
            samples, _ = self.shoot(camera, pixels, np.ones(pixels.shape[:2], dtype=bool))
            radiance[row, column] = samples.mean(axis=1)
        return radiance

    def shoot(
        self, camera: Camera, pixels: np.ndarray, near: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Follow a ray through each of a camera's pixels [n, m, 2]. near [n, m]: mask of those that
        may show a body; the others show the plate's front or the dark room.

        Returns the radiance [n, m, 3] that comes back along each ray, and the depth [n, m] of the
        first surface in metres, to which each body adds APART_M times one more than its index.
        """
        origin_m, rays = camera.centre_m.astype(np.float32), ray_directions(camera, pixels)
        radiance, depth_m = self._background(origin_m, rays)
        pixel = np.flatnonzero(near)
        rays = rays.reshape(-1, 3)[pixel]
        query = np.hstack([np.broadcast_to(origin_m, rays.shape), rays])
        hits = {key: hit.numpy() for key, hit in self.rays.cast_rays(query).items()}
        for number, (body, light) in enumerate(zip(self.bodies, self.light, strict=True)):
            seen = np.flatnonzero(hits["geometry_ids"] == number)
            along_m, uv = hits["t_hit"][seen], hits["primitive_uvs"][seen]
            weights = np.column_stack([1 - (uv[:, 0] + uv[:, 1]), uv])
            corners = body.faces[hits["primitive_ids"][seen]]
            irradiance = np.einsum("ij,ij->i", light[corners], weights).astype(np.float32)
            points_m = origin_m + along_m[:, None] * rays[seen]
            radiance.reshape(-1, 3)[pixel[seen]] = body.albedo(points_m) * irradiance[:, None]
            depth_m.reshape(-1)[pixel[seen]] = along_m + APART_M * (number + 1)
        return radiance, depth_m

    def _background(self, origin_m: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return radiance [n, m, 3] and depth [n, m] of the plane of the plate's front, on which
        all cameras look down, along rays [n, m, 3] from origin_m [3]. Beside the plate is the dark
        room."""
        import cv2

        depth_m = -origin_m[2] / rays[..., 2]
        # A texel's centre is half a texel inside its edge.
        column, row = (
            (sign * (origin_m[axis] + depth_m * rays[..., axis]) + PLATE_M[axis] / 2) / TEXEL_M
            - 0.5
            for axis, sign in enumerate((1, -1))
        )
        front = cv2.remap(self.front, column, row, cv2.INTER_LINEAR, borderValue=ROOM)
        return cv2.cvtColor(front, cv2.COLOR_GRAY2RGB), depth_m


def _centres(camera: Camera, top: int) -> np.ndarray:
    """Return the centres [ROWS, width, 2] (column and row) of a camera's pixels in the rows from
    `top` on; fewer at the bottom."""
    rows = np.arange(top, min(top + ROWS, camera.height), dtype=np.float32) + 0.5
    return np.stack(np.meshgrid(np.arange(camera.width, dtype=np.float32) + 0.5, rows), axis=-1)


def ray_directions(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Compute the viewing directions of a camera's pixels [..., 2] (column and row; the first
    pixel's centre is at 0.5): vectors [..., 3] in the world frame, of depth 1 before the camera."""
    result = np.empty((*pixels.shape[:-1], 3), pixels.dtype)
    _undistort(pixels.reshape(-1, 2), camera.params, camera.rotation, result.reshape(-1, 3))
    return result


@njit(**FAST)
def _undistort(
    pixels: np.ndarray, lens: tuple[float, ...], rotation: np.ndarray, rays: np.ndarray
) -> None:
    """Write the viewing directions of pixels [n, 2] to `rays` [n, 3]. lens: parameters of COLMAP's
    model OPENCV: u = x (1 + k1 r² + k2 r⁴ + 2 p1 y + 2 p2 x) + p2 r², for v likewise, which is
    solved for x and y by iteration."""
    fx, fy, cx, cy, k1, k2, p1, p2 = lens
    per_x, per_y = 1 / fx, 1 / fy
    for n in range(len(pixels)):
        u, v = (pixels[n, 0] - cx) * per_x, (pixels[n, 1] - cy) * per_y
        x, y = u, v
        for _ in range(UNDISTORTIONS):
            r2 = x * x + y * y
            factor = k1 * r2 + k2 * r2 * r2 + 2 * p1 * y + 2 * p2 * x
            x, y = u - x * factor - p2 * r2, v - y * factor - p1 * r2
        for axis in range(3):
            rays[n, axis] = x * rotation[0, axis] + y * rotation[1, axis] + rotation[2, axis]


def _edges(depth_m: np.ndarray) -> np.ndarray:
    """Return the mask [height, width] of the pixels at an edge: those beside which the depth
    [height, width] differs by more than 1.5 mm."""
    import cv2

    steps_m = cv2.morphologyEx(depth_m, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    return steps_m > EDGE_STEP_M


def _tones() -> np.ndarray:
    """Return the 8-bit sRGB tones (IEC 61966-2-1) of linear light at 2^16 even steps from 0 to 1,
    which is white."""
    linear = np.linspace(0, 1, 2**16)
    tone = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * tone).astype(np.uint8)
