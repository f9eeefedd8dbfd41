"""The surfaces that the cameras see, in the photo frame: target, printed back plate, and the block
under the forearm, with their reflectances and with the light of three disc lamps and of the
surroundings, which is computed once, with shadows."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.scene_file import CalibrationTarget, HandTarget
from handbench.bench.scenes.stand import PLATE_M, TEXEL_M, cuboid, plate_print
from handbench.bench.scenes.textures import foam, marked_skin, skin, styrodur
from handbench.calibration.transforms import Transform
from handbench.groundtruth.cameras import Camera
from handbench.groundtruth.mesh.surface import mesh
from handbench.support.rays import RaycastingScene

# points [n, 3] in the photo frame to reflectance [n, 3]
Albedo = Callable[[np.ndarray], np.ndarray]

PRINT_BLUR_PX = 0.4  # the print seen through a pixel's footprint
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

    def near(self, camera: Camera) -> np.ndarray:
        """Return a mask [height, width] of the pixels that may show the body: those within the
        length of its longest edge, as the camera sees it, of a vertex."""
        import cv2

        places_px = camera.project(self.vertices_m)
        edges_px = places_px[self.faces] - places_px[np.roll(self.faces, 1, axis=1)]
        longest_px = np.linalg.norm(edges_px, axis=2).max()
        if not longest_px < camera.width:  # as when a corner is behind the camera
            return np.ones((camera.height, camera.width), dtype=bool)
        cell_px = int(np.ceil(longest_px))
        shape = camera.height // cell_px + 3, camera.width // cell_px + 3
        cells = np.floor(places_px[:, ::-1] / cell_px) + 1
        cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)].astype(int)
        touched = np.zeros(shape, np.uint8)
        touched[tuple(cells.T)] = 1
        near = cv2.dilate(touched, np.ones((3, 3)))[1:, 1:] > 0
        near = near.repeat(cell_px, axis=0).repeat(cell_px, axis=1)
        return near[: camera.height, : camera.width]


def bodies(scene: Scene) -> list[PhotoBody]:
    """Return the surfaces that the cameras see before the back plate's printed front: the target
    and, if the scene has one, the block under the forearm."""
    matrix = scene.radar_from_target.inverse().matrix @ scene.radar_from_photo.matrix
    target_from_photo = Transform("photo", "target", matrix)
    # each texture adds its own small number to it
    seed = 1000 * (scene.file.seed + 1)
    texture = _target_texture(scene, seed)
    vertices_m = scene.radar_from_photo.inverse().points(np.asarray(scene.target_mesh.vertices))
    target = _body(
        vertices_m,
        np.asarray(scene.target_mesh.triangles),
        lambda points_m: texture(target_from_photo.points(points_m)),
    )
    if scene.block_m is None:
        return [target]
    return [target, _body(*cuboid(scene.block_m, GRID_M), partial(styrodur, seed=seed + 200))]


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


def lit_print(scene: Scene, rays: RaycastingScene) -> np.ndarray:
    """Make the radiance [height, width] of the back plate's front, one value per texel of its
    print: the print, blurred by a pixel's footprint, in the light of all lamps. rays: ray caster of
    all surfaces."""
    import cv2

    pixel_m = np.median(
        [np.linalg.norm(camera.centre_m) / camera.params[0] for camera in scene.cameras]
    )
    printed = cv2.GaussianBlur(
        plate_print(scene.file.seed), (0, 0), PRINT_BLUR_PX * float(pixel_m) / TEXEL_M
    )
    columns, rows = (round(side_m / GRID_M) for side_m in PLATE_M)
    row, column = np.mgrid[:rows, :columns] + 0.5
    x_m, y_m = column * GRID_M - PLATE_M[0] / 2, PLATE_M[1] / 2 - row * GRID_M
    cells_m = np.stack([x_m, y_m, np.zeros_like(x_m)], axis=-1).reshape(-1, 3)
    light = bake(rays, cells_m, np.broadcast_to([0.0, 0.0, 1.0], cells_m.shape))
    return printed * cv2.resize(
        light.reshape(rows, columns).astype(np.float32), printed.shape[::-1]
    )


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


def bake(rays: RaycastingScene, points_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Compute the light at n points [n, 3] of surfaces with the outward normals [n, 3]: from the
    lamps with soft shadows, and ambient light from the directions that no surface hides. rays: ray
    caster of all surfaces. Returns the irradiance [n], divided by π."""
    origins_m = (points_m + SHADOW_OFFSET_M * normals).astype(np.float32)
    normals = normals.astype(np.float32)
    result, open_sky, whole_sky = np.zeros((3, len(origins_m)))
    for lamp in LAMPS:
        samples_m, reach_m = lamp.samples_m().astype(np.float32), np.linalg.norm(lamp.centre_m)
        for lamp_m in samples_m:
            towards = lamp_m - origins_m
            distance_m = np.sqrt(np.einsum("ij,ij->i", towards, towards))
            cosine = np.maximum(np.einsum("ij,ij->i", towards, normals) / distance_m, 0)
            falloff = (reach_m / distance_m) ** 2
            unshadowed = clear(rays, origins_m, towards, cosine > 0)
            result += lamp.irradiance / len(samples_m) * cosine * falloff * unshadowed
    for direction in _sphere().astype(np.float32):
        cosine = np.maximum(normals @ direction, 0)
        whole_sky += cosine
        open_sky += cosine * clear(
            rays, origins_m, np.broadcast_to(direction, origins_m.shape), cosine > 0
        )
    return result + AMBIENT * open_sky / whole_sky


def clear(
    rays: RaycastingScene, origins_m: np.ndarray, towards: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """Test for each of n points whether nothing lies between it and a second point.

    origins_m [n, 3]: the points; towards [n, 3]: vectors to the second points; both float32.
    Returns 1.0 [n] for a free path and 0.0 for a blocked one. Only points in the mask wanted [n]
    are tested; others get 0.
    """
    result = np.zeros(len(origins_m), np.float32)
    tested = np.flatnonzero(wanted)
    query = np.hstack([origins_m[tested], towards[tested]])
    result[tested] = ~rays.test_occlusions(query, tfar=1.0).numpy()
    return result


def _sphere() -> np.ndarray:
    """Return unit directions [SKY_SAMPLES, 3] that are spread evenly over the sphere (a Fibonacci
    lattice)."""
    k = np.arange(SKY_SAMPLES)
    z = 1 - 2 * (k + 0.5) / SKY_SAMPLES
    angle = k * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
