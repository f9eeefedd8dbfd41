"""Simulated photographs of a scene, by ray casting: diffuse light computed at vertices, solid
textures, lens and sensor.

Effects of real photographs can be switched on: highlights, speckle, defocus, blur, motion blur,
noise, and errors of exposure and white balance.
"""

from typing import Any

import numpy as np

from handbench.bench.scenes.bodies import PhotoBody, bodies, texture_seed
from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.lens import ThinLens, blur_by_discs, line_kernel, near_edges
from handbench.bench.scenes.light import LAMPS, Light, Projector, bake, mirrored, sunflower
from handbench.bench.scenes.scene_file import Photos
from handbench.groundtruth.cameras.cameras import Camera
from handbench.radar.simulation.known_effects import Choice
from handbench.support.rays import load_open3d

ROOM = 0.03  # radiance of the dark room behind the stand
EDGE_STEP_M = 1.5e-3  # neighbouring pixels whose distance differs by more see an edge between them
ROWS = 32  # photographed at a time: what they need on the way stays in the cache
EDGE_SAMPLES = 3  # sub-pixels per direction at an edge
LENS_SAMPLES = 64  # points of the aperture at an edge out of focus
# Roberts 2018: fills the pixel evenly
R2_SEQUENCE = np.array([0.7548776662466927, 0.5698402909980532])
NOISE, EXPOSURE, WHITE_BALANCE, MOTION = 3, 4, 5, 6  # seed of each effect's generator
IDEAL: dict[
    str, dict[str, Any]
] = {  # by effect: the keys of [photos] that cause it, with the values that do not
    "highlights": {"highlights": 0.0},
    "speckle": {"speckle": 0.0},
    "defocus": {"f_number": None},
    "blur": {"blur_px": 0.0},
    "motion": {"motion_px": 0.0},
    "exposure": {"exposure_spread": 0.0},
    "white_balance": {"white_balance_spread": 0.0},
    "noise": {"full_well_e": 1e12, "read_noise_e": 0.0},  # far below a step of 8 bits
}


def photo_effects(photos: Photos) -> tuple[Choice, ...]:
    """Return one row for each effect of photographs, such as defocus or noise: whether it is on,
    and why. An effect is on if a key in the scene file's table [photos] that causes it differs from
    its ideal value."""
    rows = []
    for name, ideal in IDEAL.items():
        on = any(getattr(photos, key) != value for key, value in ideal.items())
        why = "named in [photos]" if on else f"needs photos.{next(iter(ideal))}"
        rows.append(Choice(effect=f"photos.{name}", on=on, why=why))
    return tuple(rows)


class Studio:
    """A lit scene, ready to be photographed: its bodies with the light on them, and a ray caster.
    Making one takes long, since lamps and shadows are computed for every vertex."""

    def __init__(self, scene: Scene) -> None:
        assert scene.file.photos is not None  # as there are cameras
        self.scene, self.photos = scene, scene.file.photos
        self.seed = scene.file.seed
        self.bodies = bodies(scene)
        self.aim_m = scene.radar_from_photo.inverse().points(
            scene.radar_from_target.matrix[None, :3, 3]
        )[0]
        self.projector = _projector(scene, self.photos, self.aim_m)
        o3d = load_open3d()
        self.rays = o3d.t.geometry.RaycastingScene()
        for body in self.bodies:
            self.rays.add_triangles(
                body.vertices_m.astype(np.float32), body.faces.astype(np.uint32)
            )
        self.light = [bake(self.rays, body) for body in self.bodies]

    def photograph(self, camera: Camera, number: int) -> np.ndarray:
        """Take one photograph. Returns uint8 [height, width, 3] in OpenCV's order blue, green, red.
        number: seed of the photograph's random effects (noise, exposure, white balance, direction
        of motion blur)."""
        import cv2

        radiance, photos = self.expose(camera), self.photos
        if photos.blur_px > 0:
            radiance = cv2.GaussianBlur(radiance, (0, 0), photos.blur_px)
        if photos.motion_px > 0:
            angle_rad = generator(self.seed, MOTION, number).uniform(0, np.pi)
            # The camera moved evenly; the sharp picture is that of the middle of the exposure.
            radiance = cv2.filter2D(radiance, -1, line_kernel(photos.motion_px, angle_rad))
        return develop(radiance, photos, self.seed, number)[..., ::-1]

    def expose(self, camera: Camera) -> np.ndarray:
        """Compute the light on a camera's pixels, float32 [height, width, 3] in RGB with 1 for
        white. Defocus is included; blur, motion and noise are not. Pixels at edges are means of
        several rays."""
        directions = camera.ray_directions()
        radiance = np.empty(directions.shape, dtype=np.float32)
        distance_m, label = (
            np.empty(directions.shape[:2], dtype=kind) for kind in (np.float32, np.int32)
        )
        for top in range(0, camera.height, ROWS):
            part = slice(top, top + ROWS)
            radiance[part], distance_m[part], label[part] = self.shoot(
                camera.centre_m, directions[part]
            )
        edge = _edges(distance_m, label)
        radiance[edge] = self._supersample(camera.centre_m, directions, edge)
        lens = self.lens(camera)
        if lens is None:
            return radiance
        circle_px = lens.circle_px(distance_m * (directions @ camera.rotation[2]))
        near = near_edges(edge, circle_px / 2)
        radiance = blur_by_discs(radiance, circle_px)
        radiance[near] = self._through_lens(camera, lens, directions, near)
        return radiance

    def lens(self, camera: Camera) -> ThinLens | None:
        """Return the thin lens of a camera, or None if photos.f_number is not set (then all depths
        are sharp). The lens focuses at photos.focus_m or, by default, on the target's origin."""
        if self.photos.f_number is None:
            return None
        focus_m = self.photos.focus_m or float((self.aim_m - camera.centre_m) @ camera.rotation[2])
        return ThinLens.of(
            camera, self.photos.f_number, 1e-3 * self.photos.sensor_width_mm, focus_m
        )

    def shoot(
        self, origin_m: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cast rays from the point origin_m [3] along (nearly) unit `directions` [..., 3].

        Returns the radiance [..., 3] that comes back along each ray, the distance [...] of the
        first surface in metres, and the index [...] of its body (−1: the ray meets none and shows
        the dark room).
        """
        rays = directions.reshape(-1, 3)
        query = np.empty((len(rays), 6), dtype=np.float32)
        query[:, :3], query[:, 3:] = origin_m, rays
        hits = {
            key: found.numpy()
            for key, found in self.rays.cast_rays(load_open3d().core.Tensor(query)).items()
        }
        # the number of none is the largest: -1
        distance_m, label = (hits["t_hit"], hits["geometry_ids"].view(np.int32))
        radiance = np.full(rays.shape, ROOM, dtype=np.float32)
        for number, (body, light) in enumerate(zip(self.bodies, self.light, strict=True)):
            seen = np.flatnonzero(label == number)
            ray, uv, weights = (
                rays[seen],
                hits["primitive_uvs"][seen],
                np.empty((len(seen), 3), dtype=np.float32),
            )
            weights[:, 0], weights[:, 1:] = 1 - (uv[:, 0] + uv[:, 1]), uv
            corners = body.faces[hits["primitive_ids"][seen]]
            points_m = origin_m + distance_m[seen, None].astype(np.float64) * ray
            radiance[seen] = self._shade(body, light, points_m, -ray, corners, weights)
        shape = directions.shape[:-1]
        return radiance.reshape(directions.shape), distance_m.reshape(shape), label.reshape(shape)

    def _shade(
        self,
        body: PhotoBody,
        light: Light,
        points_m: np.ndarray,
        eyes: np.ndarray,
        corners: np.ndarray,
        weights: np.ndarray,
    ) -> np.ndarray:
        """Compute the radiance [n, 3] of points [n, 3] of a body towards the camera.

        light: at the body's vertices. eyes [n, 3]: unit vectors to the camera. corners [n, 3]:
        vertex indices of each point's triangle; weights [n, 3]: barycentric coordinates in it.
        """
        photos, projector = self.photos, self.projector
        shines = body.skin and photos.highlights > 0
        irradiance = np.einsum("ij,ij->i", light.irradiance[corners], weights)
        mirror = np.zeros(len(points_m), dtype=np.float32)
        if shines or projector:
            normals = np.einsum("ijk,ij->ik", body.normals[corners], weights)
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if shines:
            unshadowed = np.einsum("ijk,ij->ik", light.open[corners], weights)
            for lamp, share in zip(LAMPS, unshadowed.T, strict=True):
                gleam = mirrored(
                    points_m, normals, eyes, lamp.samples_m(), lamp.reach_m, photos.roughness
                )
                mirror += lamp.irradiance * share * gleam
        if projector:
            even = body.board and not photos.speckle_on_board
            beam = projector.beam(self.rays, points_m, normals, even)
            irradiance = (1 - projector.contrast) * irradiance + beam * projector.incidence(
                points_m, normals
            )
            mirror *= 1 - projector.contrast
            if shines:
                at_m = projector.position_m[None]
                mirror += beam * mirrored(
                    points_m, normals, eyes, at_m, projector.throw_m, photos.roughness
                )
        diffuse = body.albedo(points_m) * irradiance[:, None].astype(np.float32)
        return diffuse + photos.highlights * mirror[:, None]

    def _supersample(
        self, centre_m: np.ndarray, directions: np.ndarray, edge: np.ndarray
    ) -> np.ndarray:
        """Compute the mean radiance [n, 3] over the area of each pixel in the mask `edge` [height,
        width], from 9 rays per pixel.

        centre_m [3]: the camera's centre. directions [height, width, 3]: rays through the pixels'
        centres.
        """
        right, down = _pixel_steps(directions, edge)
        offsets = (np.arange(EDGE_SAMPLES) + 0.5) / EDGE_SAMPLES - 0.5
        total = np.zeros((len(right), 3), dtype=np.float32)
        for u in offsets:
            for v in offsets:
                total += self.shoot(centre_m, directions[edge] + u * right + v * down)[0]
        return total / EDGE_SAMPLES**2

    def _through_lens(
        self, camera: Camera, lens: ThinLens, directions: np.ndarray, pixels: np.ndarray
    ) -> np.ndarray:
        """Compute the mean radiance [n, 3] over the area of each pixel in the mask `pixels`
        [height, width] and over the lens's aperture, from 64 rays per pixel. directions [height,
        width, 3]: rays through the pixels' centres."""
        right, down = _pixel_steps(directions, pixels)
        total = np.zeros((len(right), 3), dtype=np.float32)
        for k, (u, v) in enumerate(zip(*sunflower(1.0, LENS_SAMPLES), strict=True)):
            x, y = (k + 0.5) * R2_SEQUENCE % 1 - 0.5
            total += self.shoot(
                *lens.rays(camera, directions[pixels] + x * right + y * down, u, v)
            )[0]
        return total / LENS_SAMPLES


def _projector(scene: Scene, photos: Photos, aim_m: np.ndarray) -> Projector | None:
    if photos.speckle == 0:
        return None
    position_m = scene.radar_from_photo.inverse().points(np.array([photos.speckle_from_m]))[0]
    return Projector(
        position_m, aim_m, photos.speckle, photos.speckle_dot_m, texture_seed(scene) + 300
    )


def _pixel_steps(directions: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute how the ray direction changes from one pixel to the next, to the right and downwards,
    [n, 3] each, at the pixels in the mask `pixels` [height, width]. directions [height, width, 3]:
    rays through all pixels."""
    height, width = pixels.shape
    rows, columns = np.nonzero(pixels)
    r, c = np.clip(rows, 1, height - 2), np.clip(columns, 1, width - 2)
    return (directions[r, c + 1] - directions[r, c - 1]) / 2, (
        directions[r + 1, c] - directions[r - 1, c]
    ) / 2


def _edges(distance_m: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Return the mask [height, width] of the pixels near an edge: those next to a pixel that shows
    another body, or whose distance differs by more than 1.5 mm. distance_m, label [height, width]:
    distance and index of the body that a pixel shows."""
    import cv2

    filled = np.where(np.isfinite(distance_m), distance_m, 10.0).astype(np.float32)
    edge = np.zeros(distance_m.shape, dtype=bool)
    for axis in (0, 1):
        jump = (np.abs(np.diff(filled, axis=axis)) > EDGE_STEP_M) | (np.diff(label, axis=axis) != 0)
        first, second = (slice(None, -1), slice(None)), (slice(1, None), slice(None))
        edge[first if axis == 0 else first[::-1]] |= jump
        edge[second if axis == 0 else second[::-1]] |= jump
    return cv2.dilate(edge.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


def generator(seed: int, effect: int, number: int) -> np.random.Generator:
    """Return the random number generator of one effect in the photograph `number` of a scene with
    this seed. Each effect has its own, so that switching on another effect does not change its
    random numbers."""
    return np.random.default_rng([seed, effect, number])


def develop(radiance: np.ndarray, photos: Photos, seed: int, number: int) -> np.ndarray:
    """Convert radiance [height, width, 3], with 1 for white, to 8-bit sRGB [height, width, 3], with
    errors of exposure and white balance and with noise.

    The sensor clips bright light first; the gains of the white balance are applied afterwards.
    number: of the photograph; with the scene's seed, it determines the random numbers.
    """
    factor = exposure(photos.exposure_spread, generator(seed, EXPOSURE, number))
    gains = white_balance(photos.white_balance_spread, generator(seed, WHITE_BALANCE, number))
    result, noise = np.empty(radiance.shape, dtype=np.uint8), generator(seed, NOISE, number)
    for top in range(0, len(radiance), ROWS):
        part = slice(top, top + ROWS)
        result[part] = _srgb(np.minimum(_noisy(factor * radiance[part], photos, noise), 1) * gains)
    return result


def exposure(spread: float, random: np.random.Generator) -> float:
    """Draw the factor by which a photograph's exposure is wrong. spread: its standard deviation in
    stops (factors of two)."""
    return float(2 ** (spread * random.standard_normal()))


def white_balance(spread: float, random: np.random.Generator) -> np.ndarray:
    """Draw the gains [3] of red, green and blue by which a photograph's white balance is wrong.

    spread: standard deviation of red and blue relative to green, in stops (factors of two). The
    smallest gain is 1, as in raw converters, so that clipped pixels stay white.
    """
    red, blue = spread * random.standard_normal(2)
    gains = 2 ** np.array([red, 0.0, blue])
    return (gains / gains.min()).astype(np.float32)


def _noisy(radiance: np.ndarray, photos: Photos, random: np.random.Generator) -> np.ndarray:
    """Return the radiance with photon noise and the sensor's read noise, in the same shape."""
    electrons = np.maximum(radiance, 0) * photos.full_well_e
    spread = np.sqrt(electrons + photos.read_noise_e**2)
    return (
        electrons + spread * random.standard_normal(radiance.shape, dtype=np.float32)
    ) / photos.full_well_e


def _srgb(linear: np.ndarray) -> np.ndarray:
    """Convert linear light, with 1 for white, to 8-bit sRGB (IEC 61966-2-1) of the same shape."""
    linear = np.clip(linear, 0, 1)
    tone = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * tone).astype(np.uint8)
