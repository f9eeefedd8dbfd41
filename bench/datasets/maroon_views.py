"""Cameras for an exported capture: renderings of its surface, as MAROON's loaders open them.

The loaders want of the photographs one camera at least, and of a Kinect its factory's calibration, pictures, masks and
times. Both cameras look along the radar's z. The views have no noise: Kinect's depths are rounded to millimetres, and
nothing else is wrong with them.
"""

from pathlib import Path
from typing import Any

import numpy as np

from bench.datasets.maroon_frame import FRAME_S
from bench.datasets.maroon_sensors import LENS_MODEL, LOCATION, kinect_camera
from calibration.transforms import Transform
from groundtruth.cameras.cameras import Camera
from radar.support.files import atomic_path, write_json, write_text
from radar.support.rays import Rays

PHOTO_M, KINECT_M = np.array([0.0, -0.05, 0.0]), np.array([0.0, 0.05, 0.0])  # beside the radar's origin
FACING = np.diag([-1.0, -1.0, 1.0])  # camera from radar: x right, y down
WIDE_PX, HIGH_PX, FOCAL_PX, NAME = 640, 480, 500.0, "cam00"  # of the one photograph
KINECT = {  # sides of the sensor, and parameters that put a lens of 90° or so in the middle of each mode's picture
    "D0": ((1024, 1024), [0.5, 468 / 1024, 504 / 1024, 504 / 1024]),
    "PV0": ((4096, 3072), [0.5, 0.5, 900 / 1920, 900 / 1440]),
}
CAMS_XML = """<document version="1.5.0"><chunk>
<sensors><sensor id="0" type="frame"><calibration type="frame" class="adjusted">
<resolution width="{w}" height="{h}"/><f>{f}</f><cx>0</cx><cy>0</cy></calibration></sensor></sensors>
<cameras><camera id="0" sensor_id="0" label="{name}"><transform>{pose}</transform></camera></cameras>
<transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>0 0 0</translation><scale>1</scale></transform>
</chunk></document>
"""


def write_photograph(folder: Path, vertices: np.ndarray, faces: np.ndarray, radar_from_photo: Transform) -> None:
    """Write a photograph's camera and depth, in the photo frame and its unit as the mesh [n, 3], [m, 3]."""
    R, centre = FACING @ radar_from_photo.rotation, radar_from_photo.inverse().points(PHOTO_M)
    params = FOCAL_PX, FOCAL_PX, WIDE_PX / 2, HIGH_PX / 2
    camera = Camera(name=NAME, width=WIDE_PX, height=HIGH_PX, model="PINHOLE", params=params)
    depth = _seen(camera, R, centre, Rays(vertices, faces))
    pictures = {f"depth/{NAME}.tif": depth.astype(np.float32), f"mask/{NAME}.png": _mask(depth)}
    _write(folder, pictures | {f"rgb/{NAME}.jpg": _grey(depth)})
    pose = " ".join(f"{number:.12g}" for number in [*np.c_[R.T, centre].ravel(), 0, 0, 0, 1])
    write_text(folder / "cams.xml", CAMS_XML.format(w=WIDE_PX, h=HIGH_PX, f=FOCAL_PX, name=NAME, pose=pose))


def write_kinect(folder: Path, vertices_m: np.ndarray, faces: np.ndarray, frames: int) -> Transform:
    """Write a Kinect's folder with equal frames of a surface in the radar frame; the transform from its depth camera,
    whose points are millimetres."""
    surface = Rays(vertices_m, faces)
    still = {"Rotation": np.eye(3).ravel(), "Translation": np.zeros(3)}  # both lenses in one place
    cameras: list[dict[str, Any]] = []
    seen_m = {}
    for place, ((wide, high), lens) in KINECT.items():
        intrinsics = {"ModelParameterCount": 14, "ModelType": LENS_MODEL, "ModelParameters": [*lens, *[0.0] * 10]}
        sides = {"SensorWidth": wide, "SensorHeight": high, "MetricRadius": 1.74}
        cameras.append({"Location": f"{LOCATION}{place}", "Intrinsics": intrinsics, "Rt": still, **sides})
        seen_m[place] = _seen(kinect_camera(cameras[-1], place), FACING, KINECT_M, surface)
    write_json(folder / "calibration.json", {"CalibrationInformation": {"Cameras": cameras}})
    lines = ["filename device[us] system[ns] absolute[ns]\n"]
    for number in range(frames):
        name, time_s = f"{number:06d}", number * FRAME_S
        pictures = {
            "depth": np.round(1e3 * seen_m["D0"]).astype(np.uint16),
            "ir": _mask(seen_m["D0"]).astype(np.uint16),
        }
        pictures |= {"rgb": _grey(seen_m["PV0"]), "mask": _mask(seen_m["PV0"])}
        _write(folder, {f"{kind}/{name}.png": picture for kind, picture in pictures.items()})
        lines.append(f"{name} {1e6 * time_s:.0f} {1e9 * time_s:.0f} {1e9 * time_s:.0f}\n")
    write_text(folder / "timestamps.txt", "".join(lines))
    return Transform("kinect", "radar", np.r_[np.c_[1e-3 * FACING.T, KINECT_M], [[0, 0, 0, 1]]])


def _seen(camera: Camera, R: np.ndarray, centre: np.ndarray, surface: Rays) -> np.ndarray:
    """Depth along the camera's z [height, width] of what each pixel's centre sees from there; 0: nothing."""
    rays = camera.model_copy(update={"R": R, "t": -R @ centre}).ray_directions().reshape(-1, 3)
    distance, _ = surface.first_hits(np.broadcast_to(centre, rays.shape), rays)
    return np.where(np.isfinite(distance), distance * (rays @ R[2]), 0.0).reshape(camera.height, camera.width)


def _mask(depth: np.ndarray) -> np.ndarray:
    return np.where(depth > 0, 255, 0).astype(np.uint8)


def _grey(depth: np.ndarray) -> np.ndarray:
    return np.repeat(_mask(depth)[..., None], 3, axis=2)


def _write(folder: Path, pictures: dict[str, np.ndarray]) -> None:
    import cv2

    for name, picture in pictures.items():
        with atomic_path(folder / name) as temporary:
            temporary.write_bytes(cv2.imencode(Path(name).suffix, picture)[1].tobytes())
