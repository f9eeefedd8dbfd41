"""Photographs by Mitsuba, which shares no line with handbench's own: its rays, light, textures,
filter and film."""

from types import ModuleType
from typing import Any

import numpy as np

from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.stand import PLATE_M, plate_print
from handbench.groundtruth.cameras.cameras import Camera
from handbench.support.errors import HandbenchError
from tests.references.renderers.atlas import Atlas

SAMPLES = 16  # paths per pixel, whose noise is that of the photographs
BOUNCES = 1
SKY = 0.45
LAMPS = (
    ((-0.45, 0.60, 0.80), 0.30, 0.45),
    ((0.70, 0.10, 0.75), 0.25, 0.25),
)  # centre (photo frame), half side, light


def load_mitsuba() -> ModuleType:
    """Mitsuba, on the processor and without LLVM; a HandbenchError where it is not installed."""
    try:
        import mitsuba
    except ImportError:
        raise HandbenchError(
            "mitsuba: is not installed; expected it for this comparison alone: pip install mitsuba"
        ) from None
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


class PathTracer:
    """A scene's target, which carries an atlas, before its plate; ready to be photographed by
    pinhole cameras."""

    def __init__(self, scene: Scene, atlas: Atlas, samples: int = SAMPLES) -> None:
        self.mitsuba, self.samples = load_mitsuba(), samples
        self.scene = self.mitsuba.load_dict(self._description(scene, atlas))

    def photograph(self, camera: Camera, number: int) -> np.ndarray:
        """A photograph [height, width, 3], 8-bit BGR (OpenCV's order); `number` seeds the paths,
        whose noise it has."""
        mi = self.mitsuba
        light = mi.render(
            self.scene, sensor=mi.load_dict(sensor(mi, camera, self.samples)), seed=number
        )
        rgb = np.array(
            mi.Bitmap(light).convert(
                mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, srgb_gamma=True
            )
        )
        return rgb[..., ::-1]

    def _description(self, scene: Scene, atlas: Atlas) -> dict[str, Any]:
        mi = self.mitsuba
        rows, columns = atlas.bitmap.shape[:2]
        uv = (atlas.corner_texels() / (columns, rows)).reshape(-1, 2)
        skin = _triangles(
            mi, atlas.vertices_m[atlas.faces].reshape(-1, 3), uv, _bitmap(mi, atlas.bitmap)
        )
        width, height, _ = PLATE_M
        to_world = mi.ScalarTransform4f().scale([width / 2, height / 2, 1])
        printed = np.repeat(
            plate_print(scene.file.seed)[::-1, :, None], 3, axis=2
        )  # the first row is at v = 0
        result = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": BOUNCES + 1},
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": SKY}},
            "skin": skin,
            "plate": {
                "type": "rectangle",
                "to_world": to_world,
                "bsdf": _diffuse(_bitmap(mi, printed)),
            },
        }
        for number, (centre_m, half_m, share) in enumerate(LAMPS):
            look = mi.ScalarTransform4f().look_at(origin=centre_m, target=[0, 0, 0], up=[0, 1, 0.1])
            radiance = share * np.pi * np.dot(centre_m, centre_m) / (2 * half_m) ** 2
            result[f"lamp{number}"] = {
                "type": "rectangle",
                "to_world": look @ mi.ScalarTransform4f().scale([half_m, half_m, 1]),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": float(radiance)}},
            }
        return result


def sensor(mi: ModuleType, camera: Camera, samples: int) -> dict[str, Any]:
    """Mitsuba's description of a pinhole camera, whose pixels are square: its x points left, its y
    up."""
    fx, fy, cx, cy, *distortion = camera.params
    if fx != fy or any(distortion):
        raise HandbenchError(
            f"camera {camera.name}: has {camera.params}; expected fx = fy and no distortion"
        )
    size, to_world = {"width": camera.width, "height": camera.height}, np.eye(4)
    to_world[:3, :3] = camera.rotation.T @ np.diag([-1.0, -1.0, 1.0])
    to_world[:3, 3] = camera.centre_m
    return {
        "type": "perspective",
        "fov_axis": "x",
        "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / fx))),
        "principal_point_offset_x": 0.5 - cx / camera.width,
        "principal_point_offset_y": 0.5 - cy / camera.height,
        "near_clip": 0.01,
        "to_world": mi.ScalarTransform4f(to_world),
        "sampler": {"type": "multijitter", "sample_count": samples},
        "film": {"type": "hdrfilm", **size, "pixel_format": "rgb", "rfilter": {"type": "gaussian"}},
    }


def _triangles(
    mi: ModuleType, corners_m: np.ndarray, uv: np.ndarray, texture: dict[str, Any]
) -> Any:
    """Flat triangles from their corners [3 m, 3] with places uv [3 m, 2] on a texture."""
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(_diffuse(texture))
    mesh = mi.Mesh(
        "target", len(corners_m), len(corners_m) // 3, has_vertex_texcoords=True, props=properties
    )
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = corners_m.astype(np.float32).ravel()
    parameters["vertex_texcoords"] = uv.astype(np.float32).ravel()
    parameters["faces"] = np.arange(len(corners_m), dtype=np.uint32)
    parameters.update()
    return mesh


def _diffuse(texture: dict[str, Any]) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": texture}}


def _bitmap(mi: ModuleType, values: np.ndarray) -> dict[str, Any]:
    """Linear reflectances [rows, columns, 3] as a texture, bilinear between texels."""
    bitmap = mi.Bitmap(np.ascontiguousarray(values, dtype=np.float32))
    return {
        "type": "bitmap",
        "bitmap": bitmap,
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "clamp",
    }
