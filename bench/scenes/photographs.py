"""Simulated photographs of a scene, by ray casting: the surfaces that the cameras see, with solid
textures; diffuse light with shadows, computed at their vertices; blur and the sensor's noise."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.scene_file import CalibrationTarget, HandTarget, Photos
from handbench.bench.scenes.stand import PLATE_BOX_M, PLATE_M, TEXEL_M, cuboid, plate_print
from handbench.bench.scenes.textures import foam, marked_skin, skin, styrodur
from handbench.calibration.transforms import Transform
from handbench.groundtruth.cameras import Camera
from handbench.groundtruth.mesh.surface import mesh
from handbench.radar.simulation.scene import Choice
from handbench.support.rays import RaycastingScene, load_open3d

# points [n, 3] in the photo frame to reflectance [n, 3]
Albedo = Callable[[np.ndarray], np.ndarray]

PRINT_BLUR_PX = 0.4  # the print seen through a pixel's footprint
FRONT_M = 1e-5  # tolerance that separates the plate's front from its rim
GRID_M = 5e-3  # spacing of the light baked on plate and block


@dataclass(frozen=True)
class PhotoBody:
    """A surface that the cameras see, in the photo frame.

    vertices_m [n, 3]; faces [m, 3]: triangles of vertex indices; normals [n, 3]: outward unit
    vectors. albedo: function from points [n, 3] to reflectances [n, 3] (red, green, blue).
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    albedo: Albedo


def bodies(scene: Scene) -> list[PhotoBody]:
    """Return the surfaces that the cameras see: target, back plate and, if the scene has one, the
    block under the forearm."""
    matrix = scene.radar_from_target.inverse().matrix @ scene.radar_from_photo.matrix
    target_from_photo = Transform("photo", "target", matrix)
    # each texture adds its own small number to it
    seed = 1000 * (scene.file.seed + 1)
    texture, plain = _target_texture(scene, seed), partial(styrodur, seed=seed + 200)
    pixel_m = float(
        np.median([np.linalg.norm(camera.centre_m) / camera.params[0] for camera in scene.cameras])
    )
    vertices_m = scene.radar_from_photo.inverse().points(np.asarray(scene.target_mesh.vertices))
    result = [
        _body(
            vertices_m,
            np.asarray(scene.target_mesh.triangles),
            lambda points_m: texture(target_from_photo.points(points_m)),
        ),
        _body(*cuboid(PLATE_BOX_M, GRID_M), _plate_albedo(scene.file.seed, pixel_m, plain)),
    ]
    if scene.block_m is not None:
        result.append(_body(*cuboid(scene.block_m, GRID_M), plain))
    return result


def _target_texture(scene: Scene, seed: int) -> Albedo:
    """Return the target's reflectance as a function of points [n, 3] in the target's frame: foam
    for the calibration target, skin for any other target."""
    target = scene.file.target
    if isinstance(target, HandTarget):
        return marked_skin(target.angles, seed, target.build)
    return partial(foam if isinstance(target, CalibrationTarget) else skin, seed=seed)


def _body(vertices_m: np.ndarray, faces: np.ndarray, albedo: Albedo) -> PhotoBody:
    surface = mesh(vertices_m, faces)
    surface.compute_vertex_normals()
    return PhotoBody(vertices_m, faces, np.asarray(surface.vertex_normals), albedo)


def _plate_albedo(seed: int, pixel_m: float, plain: Albedo) -> Albedo:
    """Return the back plate's reflectance as a function of points [n, 3] in the photo frame: the
    print on its front, the foam `plain` elsewhere.

    seed: of the print. pixel_m: size of a camera's pixel on the plate, by which the print is
    blurred.
    """
    import cv2

    printed = cv2.GaussianBlur(plate_print(seed), (0, 0), PRINT_BLUR_PX * pixel_m / TEXEL_M)

    def albedo(points_m: np.ndarray) -> np.ndarray:
        # A texel's centre is half a texel inside its edge.
        places = (points_m[:, :2] * (1, -1) + np.array(PLATE_M) / 2) / TEXEL_M - 0.5
        column, row = places.astype(np.float32).T
        grey = np.empty(len(points_m), dtype=np.float32)
        rows = 16_384  # cv2.remap refuses maps longer than 2^15
        for i in range(0, len(grey), rows):
            part = slice(i, i + rows)
            grey[part] = cv2.remap(
                printed,
                column[part, None],
                row[part, None],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )[:, 0]
        reflectance = np.repeat(grey[:, None], 3, axis=1)
        rim = np.abs(points_m[:, 2]) > FRONT_M
        reflectance[rim] = plain(points_m[rim])
        return reflectance

    return albedo


@dataclass(frozen=True)
class Lamp:
    """A lamp: a disc that faces the board.

    centre_m: in the photo frame. irradiance: that of a surface at the board's centre that faces the
    lamp, divided by π, so that a white surface with irradiance 1 has radiance 1.
    """

    centre_m: tuple[float, float, float]
    radius_m: float
    irradiance: float

    def samples_m(self) -> np.ndarray:
        """Return points [n, 3] spread evenly over the lamp's disc, in the photo frame, metres."""
        centre_m = np.array(self.centre_m)
        z = centre_m / np.linalg.norm(centre_m)
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        k = np.arange(LAMP_SAMPLES) + 0.5
        radius_m, angle = self.radius_m * np.sqrt(k / LAMP_SAMPLES), k * np.pi * (3 - np.sqrt(5))
        u, v = radius_m * np.cos(angle), radius_m * np.sin(angle)
        return centre_m + u[:, None] * x + v[:, None] * np.cross(z, x)


LAMPS = (
    Lamp((-0.55, 0.75, 0.85), 0.14, 0.62),
    Lamp((0.85, 0.15, 0.80), 0.18, 0.34),
    Lamp((0.05, -0.55, 0.95), 0.18, 0.16),
)
AMBIENT = 0.30
LAMP_SAMPLES, SKY_SAMPLES = 24, 128
SHADOW_OFFSET_M = 2e-4


def bake(rays: RaycastingScene, body: PhotoBody) -> np.ndarray:
    """Compute the light at the n vertices of a body: from the lamps with soft shadows, and ambient
    light from the directions that no surface hides. rays: ray caster of all bodies. Returns the
    irradiance [n], divided by π."""
    origins_m = body.vertices_m + SHADOW_OFFSET_M * body.normals
    result = np.zeros(len(origins_m))
    for lamp in LAMPS:
        samples_m, reach_m = lamp.samples_m(), np.linalg.norm(lamp.centre_m)
        for lamp_m in samples_m:
            towards = lamp_m - origins_m
            distance_m = np.linalg.norm(towards, axis=1)
            cosine = np.maximum(np.einsum("ij,ij->i", towards, body.normals) / distance_m, 0)
            falloff = (reach_m / distance_m) ** 2
            unshadowed = clear(rays, origins_m, towards, cosine > 0)
            result += lamp.irradiance / len(samples_m) * cosine * falloff * unshadowed
    open_sky, whole_sky = np.zeros(len(origins_m)), np.zeros(len(origins_m))
    for direction in _sphere():
        cosine = np.maximum(body.normals @ direction, 0)
        whole_sky += cosine
        open_sky += cosine * clear(
            rays, origins_m, np.broadcast_to(direction, origins_m.shape), cosine > 0
        )
    return result + AMBIENT * open_sky / whole_sky


def clear(
    rays: RaycastingScene, origins_m: np.ndarray, towards: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """Test for each of n points whether nothing lies between it and a second point.

    origins_m [n, 3]: the points; towards [n, 3]: vectors to the second points. Returns 1.0 [n] for
    a free path and 0.0 for a blocked one. Only points in the mask wanted [n] are tested; others get
    0.
    """
    tensor = load_open3d().core.Tensor
    result = np.zeros(len(origins_m))
    query = np.concatenate([origins_m[wanted], towards[wanted]], axis=1).astype(np.float32)
    result[wanted] = ~rays.test_occlusions(tensor(query), tfar=1.0).numpy()
    return result


def _sphere() -> np.ndarray:
    """Return unit directions [SKY_SAMPLES, 3] that are spread evenly over the sphere (a Fibonacci
    lattice)."""
    k = np.arange(SKY_SAMPLES)
    z = 1 - 2 * (k + 0.5) / SKY_SAMPLES
    angle = k * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


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
