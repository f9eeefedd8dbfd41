"""The surfaces that the cameras see, with their reflectances, in the photo frame: target, printed
back plate, and the block under the forearm."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.scene_file import CalibrationTarget, HandTarget
from handbench.bench.scenes.stand import PLATE_BOX_M, PLATE_M, TEXEL_M, cuboid, plate_print
from handbench.bench.scenes.textures import foam, marked_skin, skin, styrodur
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.surface import mesh

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
