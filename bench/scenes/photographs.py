"""Simulated photographs of a scene, by ray casting: diffuse light computed at vertices, solid
textures, blur and the sensor's noise."""

import itertools

import numpy as np

from handbench.bench.scenes.bodies import bodies
from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.light import bake
from handbench.bench.scenes.scene_file import Photos
from handbench.groundtruth.cameras import Camera
from handbench.radar.simulation.scene import Choice
from handbench.support.rays import load_open3d

ROOM = 0.03  # radiance of the dark room behind the stand
EDGE_STEP_M = 1.5e-3  # neighbouring pixels whose distance differs by more see an edge between them
ROWS = 32  # photographed at a time: what they need on the way stays in the cache
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
        for body in self.bodies:
            self.rays.add_triangles(
                body.vertices_m.astype(np.float32), body.faces.astype(np.uint32)
            )
        self.light = [bake(self.rays, body) for body in self.bodies]

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
        random, full_well_e = (
            np.random.default_rng([self.seed, NOISE, number]),
            self.photos.full_well_e,
        )
        parts = []
        for top in range(0, len(radiance), ROWS):
            electrons = np.maximum(radiance[top : top + ROWS], 0) * full_well_e
            spread = np.sqrt(electrons + self.photos.read_noise_e**2)
            noise = spread * random.standard_normal(electrons.shape, dtype=np.float32)
            parts.append(_srgb((electrons + noise) / full_well_e))
        return np.concatenate(parts)

    def expose(self, camera: Camera) -> np.ndarray:
        """Compute the light on a camera's pixels, float32 [height, width, 3] in RGB with 1 for
        white, without blur and noise. Pixels at edges are means of several rays."""
        pixels = np.moveaxis(np.mgrid[: camera.height, : camera.width][::-1], 0, -1) + 0.5
        parts = [
            self.shoot(camera, pixels[top : top + ROWS]) for top in range(0, camera.height, ROWS)
        ]
        radiance, distance_m, label = map(np.concatenate, zip(*parts, strict=True))
        edge = _edges(distance_m, label)
        offsets = (np.arange(EDGE_SAMPLES) + 0.5) / EDGE_SAMPLES - 0.5
        samples = (
            self.shoot(camera, pixels[edge] + offset)[0]
            for offset in itertools.product(offsets, repeat=2)
        )
        radiance[edge] = sum(samples, np.zeros(3, np.float32)) / EDGE_SAMPLES**2
        return radiance

    def shoot(
        self, camera: Camera, pixels: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cast a ray through each of a camera's pixels [..., 2].

        Returns the radiance [..., 3] that comes back along each ray, the distance [...] of the
        first surface in metres, and the index [...] of its body (−1: the ray meets none and shows
        the dark room).
        """
        origin_m, rays = camera.centre_m, ray_directions(camera, pixels.reshape(-1, 2))
        query = np.hstack([np.broadcast_to(origin_m, rays.shape), rays]).astype(np.float32)
        hits = {
            key: hit.numpy()
            for key, hit in self.rays.cast_rays(load_open3d().core.Tensor(query)).items()
        }
        # the number of none is the largest: -1
        distance_m, label = hits["t_hit"], hits["geometry_ids"].view(np.int32)
        radiance = np.full(rays.shape, ROOM, dtype=np.float32)
        for number, (body, light) in enumerate(zip(self.bodies, self.light, strict=True)):
            seen = np.flatnonzero(label == number)
            ray, uv = rays[seen], hits["primitive_uvs"][seen]
            weights = np.column_stack([1 - (uv[:, 0] + uv[:, 1]), uv])
            corners = body.faces[hits["primitive_ids"][seen]]
            points_m = origin_m + distance_m[seen, None].astype(np.float64) * ray
            irradiance = np.einsum("ij,ij->i", light[corners], weights).astype(np.float32)
            radiance[seen] = body.albedo(points_m) * irradiance[:, None]
        shape = pixels.shape[:-1]
        return radiance.reshape(*shape, 3), distance_m.reshape(shape), label.reshape(shape)


def ray_directions(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Compute the viewing directions of a camera's pixels [n, 2] (column and row; the first pixel's
    centre is at 0.5): unit vectors [n, 3] in the world frame."""
    rays = np.asarray(camera.colmap().cam_from_img(pixels)) @ camera.rotation[:2]
    rays += camera.rotation[2]
    rays /= np.sqrt(np.einsum("ij,ij->i", rays, rays))[:, None]
    return rays


def _edges(distance_m: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Return the mask [height, width] of the pixels near an edge: those next to a pixel that shows
    another body, or whose distance differs by more than 1.5 mm. distance_m, label [height, width]:
    distance and index of the body that a pixel shows."""
    import cv2

    filled = np.nan_to_num(distance_m, posinf=10.0)
    edge = np.zeros(distance_m.shape, dtype=bool)
    for far, body, beside in ((filled, label, edge), (filled.T, label.T, edge.T)):
        jump = (np.abs(np.diff(far, axis=0)) > EDGE_STEP_M) | (np.diff(body, axis=0) != 0)
        beside[:-1] |= jump
        beside[1:] |= jump
    return cv2.dilate(edge.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


def _srgb(linear: np.ndarray) -> np.ndarray:
    """Convert linear light, with 1 for white, to 8-bit sRGB (IEC 61966-2-1) of the same shape."""
    linear = np.clip(linear, 0, 1)
    tone = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * tone).astype(np.uint8)
