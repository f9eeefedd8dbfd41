"""Photographs of a scene by ray casting: baked diffuse light, solid textures, lens distortion, sensor noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from bench.scenes.file import CalibrationTarget, HandTarget, Photos
from bench.scenes.scene import Scene
from bench.scenes.skin import Skin
from bench.scenes.stand import PLATE_M, TEXEL_M, cuboid, plate_print
from bench.scenes.textures import foam, skin, styrodur
from calibration.meshes import load_open3d, mesh
from calibration.transforms import Transform
from groundtruth.cameras import Camera

Albedo = Callable[[np.ndarray], np.ndarray]  # points [n, 3] in the photo frame to reflectance [n, 3]

# Disc lamps in the photo frame: centre (metres), radius (metres), irradiance at the board's centre.
LAMPS = (((-0.55, 0.75, 0.85), 0.14, 0.62), ((0.85, 0.15, 0.80), 0.18, 0.34), ((0.05, -0.55, 0.95), 0.18, 0.16))
AMBIENT = 0.30
LAMP_SAMPLES, SKY_SAMPLES = 24, 128
SHADOW_OFFSET_M = 2e-4
ROOM = 0.03  # radiance of the dark room behind the stand
PRINT_BLUR_PX = 0.4  # the print seen through a pixel's footprint
EDGE_STEP_M = 1.5e-3  # neighbouring pixels whose distance differs by more see an edge between them
EDGE_SAMPLES = 3  # sub-pixels per direction at an edge
FRONT_M = 1e-5  # the plate's front is told from its rim with this tolerance
GRID_M = 5e-3  # spacing of the light baked on plate and block


@dataclass(frozen=True)
class Body:
    """A surface in the photo frame: vertices [n, 3] in metres, faces [m, 3], outward unit normals [n, 3]."""

    vertices_m: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    albedo: Albedo


class Studio:
    """A lit scene, ready to be photographed."""

    def __init__(self, scene: Scene) -> None:
        self.photos: Photos = scene.file.photos
        self.seed = scene.file.seed
        self.bodies = _bodies(scene)
        o3d = load_open3d()
        self.rays = o3d.t.geometry.RaycastingScene()
        for body in self.bodies:
            self.rays.add_triangles(body.vertices_m.astype(np.float32), body.faces.astype(np.uint32))
        self.light = [bake(self.rays, body) for body in self.bodies]

    def photograph(self, camera: Camera, number: int) -> np.ndarray:
        """One photograph [height, width, 3] as 8-bit BGR (OpenCV's order); `number` seeds its noise."""
        import cv2

        directions = camera.ray_directions()
        radiance, depth, label = self.shoot(camera.centre_m, directions)
        rows, columns = np.nonzero(_edges(depth, label))
        radiance[rows, columns] = self._supersample(camera.centre_m, directions, rows, columns)
        if self.photos.blur_px > 0:
            radiance = cv2.GaussianBlur(radiance, (0, 0), self.photos.blur_px)
        random = np.random.default_rng([self.seed, 3, number])
        return _develop(_expose(radiance, self.photos, random))[..., ::-1]

    def shoot(self, centre_m: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Radiance [..., 3], distance [...] and the body's number [...] (-1: none) seen along `directions` [..., 3]."""
        hits = _cast(self.rays, np.broadcast_to(centre_m, directions.shape), directions)
        depth, label = hits["t_hit"], hits["geometry_ids"].astype(np.int64)
        label[~np.isfinite(depth)] = -1
        radiance = np.full(directions.shape, ROOM, dtype=np.float32)
        for number, (body, light) in enumerate(zip(self.bodies, self.light, strict=True)):
            seen = label == number
            points_m = centre_m + depth[seen, None].astype(np.float64) * directions[seen]
            uv = hits["primitive_uvs"][seen]
            weights = np.concatenate([1 - uv.sum(axis=1, keepdims=True), uv], axis=1)
            irradiance = np.einsum("ij,ij->i", light[body.faces[hits["primitive_ids"][seen]]], weights)
            radiance[seen] = body.albedo(points_m) * irradiance[:, None].astype(np.float32)
        return radiance, depth, label

    def _supersample(
        self, centre_m: np.ndarray, directions: np.ndarray, rows: np.ndarray, columns: np.ndarray
    ) -> np.ndarray:
        """Mean radiance [n, 3] over the area of the pixels at `rows`, `columns`."""
        height, width = directions.shape[:2]
        r, c = np.clip(rows, 1, height - 2), np.clip(columns, 1, width - 2)
        right = (directions[r, c + 1] - directions[r, c - 1]) / 2
        down = (directions[r + 1, c] - directions[r - 1, c]) / 2
        offsets = (np.arange(EDGE_SAMPLES) + 0.5) / EDGE_SAMPLES - 0.5
        total = np.zeros((len(rows), 3), dtype=np.float32)
        for u in offsets:
            for v in offsets:
                total += self.shoot(centre_m, directions[rows, columns] + u * right + v * down)[0]
        return total / EDGE_SAMPLES**2


def bake(rays: object, body: Body) -> np.ndarray:
    """Irradiance [n] at a body's vertices: three lamps with soft shadows and an occluded ambient light."""
    origins_m = body.vertices_m + SHADOW_OFFSET_M * body.normals
    result = np.zeros(len(origins_m))
    for centre_m, radius_m, strength in LAMPS:
        samples = _disc(np.array(centre_m), radius_m)
        for lamp_m in samples:
            towards = lamp_m - origins_m
            distance_m = np.linalg.norm(towards, axis=1)
            cosine = np.maximum(np.einsum("ij,ij->i", towards, body.normals) / distance_m, 0)
            falloff = (np.linalg.norm(centre_m) / distance_m) ** 2
            result += strength / len(samples) * cosine * falloff * _clear(rays, origins_m, towards, cosine > 0)
    open_sky, whole_sky = np.zeros(len(origins_m)), np.zeros(len(origins_m))
    for direction in _sphere(SKY_SAMPLES):
        cosine = np.maximum(body.normals @ direction, 0)
        whole_sky += cosine
        open_sky += cosine * _clear(rays, origins_m, np.broadcast_to(direction, origins_m.shape), cosine > 0)
    return result + AMBIENT * open_sky / whole_sky


def _clear(rays: object, origins_m: np.ndarray, towards: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """1 where nothing stands between an origin and origin + towards, else 0; asked only where `wanted`."""
    tensor = load_open3d().core.Tensor
    result = np.zeros(len(origins_m))
    query = np.concatenate([origins_m[wanted], towards[wanted]], axis=1).astype(np.float32)
    result[wanted] = ~rays.test_occlusions(tensor(query), tfar=1.0).numpy()
    return result


def _cast(rays: object, origins_m: np.ndarray, directions: np.ndarray) -> dict[str, np.ndarray]:
    query = np.concatenate([origins_m, directions], axis=-1, dtype=np.float32)
    hits = rays.cast_rays(load_open3d().core.Tensor(query))
    return {key: hits[key].numpy() for key in ("t_hit", "geometry_ids", "primitive_ids", "primitive_uvs")}


def _bodies(scene: Scene) -> list[Body]:
    photo_from_radar = scene.radar_from_photo.inverse()
    target_from_photo = Transform(
        "photo", "target", scene.radar_from_target.inverse().matrix @ scene.radar_from_photo.matrix
    )
    texture = _target_texture(scene)

    def target_albedo(points_m: np.ndarray) -> np.ndarray:
        return texture(target_from_photo.points(points_m))

    plain = partial(styrodur, seed=_texture_seed(scene) + 200)
    pixel_m = np.median([np.linalg.norm(camera.centre_m) / camera.params[0] for camera in scene.cameras])
    vertices_m = photo_from_radar.points(np.asarray(scene.target_mesh.vertices))
    bodies = [
        _body(vertices_m, np.asarray(scene.target_mesh.triangles), target_albedo),
        _body(*_plate(), _Plate(scene.file.seed, pixel_m, plain)),
    ]
    if scene.block_m is not None:
        bodies.append(_body(*cuboid(*scene.block_m, GRID_M), plain))
    return bodies


def _target_texture(scene: Scene) -> Albedo:
    """Reflectance over the target's own frame."""
    target, contrast, seed = scene.file.target, scene.file.photos.texture_contrast, _texture_seed(scene)
    if isinstance(target, HandTarget):
        return Skin(target.angles, contrast, seed)
    return partial(foam if isinstance(target, CalibrationTarget) else skin, contrast=contrast, seed=seed)


def _texture_seed(scene: Scene) -> int:
    """Textures take small numbers above their seed: keep those of neighbouring scenes apart."""
    return 1000 * (scene.file.seed + 1)


def _plate() -> tuple[np.ndarray, np.ndarray]:
    width, height, thickness = PLATE_M
    return cuboid(np.array([-width / 2, -height / 2, -thickness]), np.array([width / 2, height / 2, 0.0]), GRID_M)


def _body(vertices_m: np.ndarray, faces: np.ndarray, albedo: Albedo) -> Body:
    surface = mesh(vertices_m, faces)
    surface.compute_vertex_normals()
    return Body(vertices_m, faces, np.asarray(surface.vertex_normals), albedo)


class _Plate:
    """Reflectance of the back plate: print on its front, plain foam elsewhere."""

    def __init__(self, seed: int, pixel_m: float, plain: Albedo) -> None:
        import cv2

        self.print = cv2.GaussianBlur(plate_print(seed), (0, 0), PRINT_BLUR_PX * pixel_m / TEXEL_M)
        self.plain = plain

    def __call__(self, points_m: np.ndarray) -> np.ndarray:
        import cv2

        # A texel's centre lies half a texel inside its edge.
        column = ((points_m[:, 0] + PLATE_M[0] / 2) / TEXEL_M - 0.5).astype(np.float32)
        row = ((PLATE_M[1] / 2 - points_m[:, 1]) / TEXEL_M - 0.5).astype(np.float32)
        grey = np.empty(len(points_m), dtype=np.float32)
        rows = 16_384  # cv2.remap refuses maps longer than 2^15
        for i in range(0, len(grey), rows):
            part = slice(i, i + rows)
            grey[part] = cv2.remap(
                self.print, column[part, None], row[part, None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )[:, 0]
        reflectance = np.repeat(grey[:, None], 3, axis=1)
        rim = np.abs(points_m[:, 2]) > FRONT_M
        reflectance[rim] = self.plain(points_m[rim])
        return reflectance


def _edges(depth: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Pixels [height, width] that see an edge between themselves and a neighbour."""
    import cv2

    filled = np.where(np.isfinite(depth), depth, 10.0).astype(np.float32)
    edge = np.zeros(depth.shape, dtype=bool)
    for axis in (0, 1):
        jump = (np.abs(np.diff(filled, axis=axis)) > EDGE_STEP_M) | (np.diff(label, axis=axis) != 0)
        first, second = (slice(None, -1), slice(None)), (slice(1, None), slice(None))
        edge[first if axis == 0 else first[::-1]] |= jump
        edge[second if axis == 0 else second[::-1]] |= jump
    return cv2.dilate(edge.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


def _expose(radiance: np.ndarray, photos: Photos, random: np.random.Generator) -> np.ndarray:
    """Photon and read noise."""
    electrons = np.maximum(radiance, 0) * photos.full_well_e
    spread = np.sqrt(electrons + photos.read_noise_e**2)
    return (electrons + spread * random.standard_normal(radiance.shape, dtype=np.float32)) / photos.full_well_e


def _develop(linear: np.ndarray) -> np.ndarray:
    """8-bit sRGB."""
    linear = np.clip(linear, 0, 1)
    tone = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * tone).astype(np.uint8)


def _disc(centre_m: np.ndarray, radius_m: float) -> np.ndarray:
    """Points [n, 3] spread evenly over a disc that faces the board (a sunflower)."""
    k = np.arange(LAMP_SAMPLES) + 0.5
    radius, angle = radius_m * np.sqrt(k / LAMP_SAMPLES), k * np.pi * (3 - np.sqrt(5))
    z = centre_m / np.linalg.norm(centre_m)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return centre_m + (radius * np.cos(angle))[:, None] * x + (radius * np.sin(angle))[:, None] * np.cross(z, x)


def _sphere(count: int) -> np.ndarray:
    """Unit directions [count, 3] spread evenly (a Fibonacci lattice)."""
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
