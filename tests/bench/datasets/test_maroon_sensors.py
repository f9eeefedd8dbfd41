"""MAROON's other sensors: their files become depths on the radar's pixels, scored and used as any
other.

The references are a plane that leans, and the makers' formulas written out here: pictures of the
plane are computed by them pixel by pixel, without our cameras or our ray caster.
"""

import json
import shutil

import cv2
import numpy as np
import pytest

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.maroon_alignment import kinect_camera
from handbench.bench.run.reconstruct_stage import Imager
from handbench.cli.main import main
from handbench.radar.data.depthmap import load_depthmap
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from tests.bench.datasets.foreign_captures import PLACE_M, plane_m
from tests.bench.datasets.maroon_writer import FACING

GRID = PixelGrid(np.linspace(-0.038, -0.022, 9), np.linspace(0.012, 0.028, 9))
ROUNDED_M = 0.5e-3 * 1.1  # depths are whole millimetres; the plane leans by 0.2
PLACE = np.array([-0.02, 0.01, 0.0])  # of every sensor


def rays_of(width, height, f, cx, cy):
    """Directions (x, y, 1) [height, width, 2] of pixels whose first centre is at 0."""
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    return np.stack([(u - cx) / f, (v - cy) / f], axis=-1)


def depth_mm(rays):
    """What a sensor at PLACE sees of the plane along its z: z = (a + 0.2 (X − X0)) with X = PLACE_x
    − x z."""
    return 1e3 * (plane_m(PLACE[0]) / (1 + 0.2 * rays[..., 0]))


def write(folder, name, pictures, calibration):
    for file, picture in pictures.items():
        (folder / name / file).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name / file), picture)
    (folder / name / "calibration.json").write_text(json.dumps(calibration))


def align(folder, name, unit_m=1e-3, axes=FACING, place=PLACE, **more):
    """Put a sensor's matrix into alignment.json; its points are multiples of unit_m."""
    matrix = np.diag([-1, 1, 1, 1]) @ np.r_[np.c_[unit_m * axes.T, place], [[0, 0, 0, 1]]]
    file = folder / "alignment.json"
    calib = json.loads(file.read_text()) | {f"{name}2radar": matrix.tolist(), **more}
    file.write_text(json.dumps(calib))


def found(folder, name, frame=0):
    chosen = method(name)
    axes = {
        axis: {"start_m": values_m[0], "stop_m": values_m[-1], "step_m": 0.002}
        for axis, values_m in (("x", GRID.x_m), ("y", GRID.y_m))
    }
    echoes = open_capture(folder).echoes()
    return chosen.run(echoes, chosen.configure(axes, "test"), frame).depth.z_m


LENS = {"fx": 400.0, "fy": 400.0, "cx": 40.3, "cy": 50.7}


@pytest.mark.parametrize(
    ("name", "picture", "lens"),
    [("realsense", "depth/000000.png", "rgb"), ("zed", "depth/left/000000.png", "left")],
)
def test_stereo_cameras(mine, name, picture, lens):
    """sensors/realsense_data_loader.py and zed_data_loader.py: xyz = K⁻¹ (u z, v z, z), pixels
    counted from 0."""
    depth = np.round(depth_mm(rays_of(100, 80, 400.0, 40.3, 50.7))).astype(np.uint16)
    write(mine, name, {picture: depth}, {lens: LENS})
    align(mine, name)
    off_m = found(mine, name) - plane_m(GRID.x_m)
    assert np.abs(off_m).max() < ROUNDED_M
    assert abs(off_m.mean()) < 0.1e-3  # and not half a pixel aside, which were 0.07 mm by the lean
    align(mine, name, unit_m=1.0)  # a matrix from metres
    np.testing.assert_allclose(found(mine, name) - plane_m(GRID.x_m), off_m, atol=1e-9)
    align(mine, name, unit_m=0.01)
    with pytest.raises(HandbenchError, match=r"has the scale 0\.01; expected 0\.001"):
        found(mine, name)


def test_steps_of_more_than_a_centimetre_are_not_joined(mine):
    depth = np.tile(np.repeat([300, 309, 320], [40, 20, 40]).astype(np.uint16), (80, 1))
    write(mine, "realsense", {"depth/000000.png": depth}, {"rgb": LENS})
    align(mine, "realsense")
    vertices, faces = open_capture(mine).sensors()["realsense"].triangles()
    assert set(np.ptp(vertices[faces][..., 2], axis=1).round(9)) == {0.0, 9.0}
    assert len(faces) == 2 * 79 * 98  # all quads but a column


def test_the_scale_and_the_mask_of_a_realsense(mine):
    """Counts of a tenth of a millimetre; the last frame's mask leaves the picture's right half: our
    smaller x."""
    depth = (10 * depth_mm(rays_of(100, 80, 400.0, 40.3, 50.7))).round().astype(np.uint16)
    mask = np.zeros((80, 100), np.uint8)
    u = 40.3 + 400 * (PLACE[0] - PLACE_M[0]) / PLACE_M[2]  # where x = PLACE_M[0] is seen
    mask[:, int(u) + 2 :] = 255
    pictures = {"depth/000000.png": depth, "mask/000000.png": 255 - mask, "mask/000003.png": mask}
    write(mine, "realsense", pictures, {"capture": {"scale": 1e-4}, "rgb": LENS})
    align(mine, "realsense")
    z_m = found(mine, "realsense")
    expected_m = np.broadcast_to(plane_m(GRID.x_m[:3]), (9, 3))
    np.testing.assert_allclose(z_m[:, :3], expected_m, atol=0.06e-3)
    assert np.isnan(z_m[:, 5:]).all()


# cx cy fx fy k1…k6 · · p2 p1
FACTORY = [0.51, 0.47, 0.49, 0.5, 0.3, -0.2, 0.1, 0.4, -0.1, 0.05, 0, 0, 4e-4, -3e-4]
COLOUR = [0.5, 0.51, 0.478, 0.637, 0.33, -2.4, 1.4, 0.2, -2.3, 1.3, 0, 0, -1e-4, -2e-4]
DEPTH_MODE, COLOUR_MODE = ((1024, 1024), (192, 180)), ((1920, 1440), (0, 180))


def seen_by(factory, mode, points):
    """Pixels [n, 2] of points, the first one's centre at 0: the SDK's transform with the lens that
    it calls Brown–Conrady (mode_specific_calibration.c, intrinsic_transformation.c)."""
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = factory
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r2 = x * x + y * y
    d = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u = (x * d + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) * fx + cx
    v = (y * d + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)) * fy + cy
    return np.stack([u, v], axis=1) * mode[0] - mode[1] - 0.5


def entry(place, factory, rotation=None, shift_m=(0, 0, 0)):
    """A camera of the factory's calibration."""
    rotation = np.eye(3) if rotation is None else rotation
    return {
        "Location": f"CALIBRATION_CameraLocation{place}",
        "Rt": {"Rotation": rotation.ravel().tolist(), "Translation": list(shift_m)},
        "Intrinsics": {
            "ModelParameters": factory,
            "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
        },
    }


def test_a_kinect_s_lens_bends_as_its_maker_s_does():
    """Terms of each kind, strong enough to be distinguished; the first pixel's centre is at ½ with
    us."""
    strong = [*FACTORY[:12], 0.02, -0.03]
    points = np.random.default_rng(3).uniform([-0.2, -0.2, 0.5], [0.2, 0.2, 1.0], (20, 3))
    pixels = kinect_camera(entry("D0", strong)).colmap().img_from_cam(points)
    np.testing.assert_allclose(pixels, seen_by(strong, DEPTH_MODE, points) + 0.5, atol=1e-9)


def test_a_kinect_with_its_lenses(mine):
    """A picture with depths at the pixels nearest to a net of points of the plane; the colour
    camera stands 32 mm aside and is turned, its mask has a hole, and the matrix is of its frame,
    which is their default (a matrix of the depth camera's: below)."""
    shutil.rmtree(mine / "kinect")
    net = np.meshgrid(np.arange(-0.05, -0.01, 0.0002), np.arange(0, 0.04, 0.0002))
    hole = np.array([-0.028, 0.024])
    edges = hole + 0.003 * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    points_mm, corners_mm = (
        1e3 * (np.stack([x, y, plane_m(x)], axis=-1) - PLACE) @ FACING.T
        for x, y in (map(np.ravel, net), edges.T)
    )
    u, v = seen_by(FACTORY, DEPTH_MODE, points_mm).round().astype(int).T
    depth, mask = np.zeros((576, 640), np.uint16), np.full((1080, 1920), 255, np.uint8)
    depth[v, u] = np.round(points_mm[:, 2])
    rotation, _ = cv2.Rodrigues(np.array([0.05, -0.02, 0.01]))
    shift_m = np.array([-0.032, -0.002, 0.004])
    places = seen_by(COLOUR, COLOUR_MODE, corners_mm @ rotation.T + 1e3 * shift_m)
    cv2.fillConvexPoly(mask, cv2.convexHull(places.round().astype(np.int32)), 0)
    cameras = [entry("D0", FACTORY), entry("PV0", COLOUR, rotation, shift_m.tolist())]
    pictures = {"depth/000000.png": depth, "mask/000000.png": mask}
    write(mine, "kinect", pictures, {"CalibrationInformation": {"Cameras": cameras}})
    # p_radar = M (R p + t): the colour camera's own place
    place = PLACE - FACING.T @ rotation.T @ shift_m
    align(mine, "kinect", axes=rotation @ FACING, place=place, kinect_calib={})
    off_m = found(mine, "kinect") - plane_m(GRID.x_m)
    near = np.abs(np.stack(np.meshgrid(GRID.x_m, GRID.y_m), axis=-1) - hole).max(axis=-1)
    assert np.isnan(off_m[near < 0.002]).all()
    # a net's point lies up to half a pixel beside the pixel's centre
    assert np.abs(off_m[near > 0.005]).max() < ROUNDED_M + 0.1e-3
    assert np.abs(off_m[near > 0.005].mean()) < 0.05e-3


def test_a_rendered_kinect_is_imaged_beside_the_radar_and_guides_it(native, maroon, tmp_path):
    """By the capture's own pixels; without what the radar knows of its own trust."""
    file = tmp_path / "kinect.npz"
    assert main(["reconstruct", str(maroon), "--method", "kinect", "-o", str(file)]) == 0
    kinect = load_depthmap(file)
    assert kinect.p_gross is None and kinect.z_m.shape == (11, 11)
    expected_m = np.broadcast_to(plane_m(kinect.x_m[1:-1]), (9, 9))
    np.testing.assert_allclose(kinect.z_m[1:-1, 1:-1], expected_m, atol=ROUNDED_M)
    guided = Imager(maroon, "prior-2fsk", {"prior": "kinect"}).images().results[0].depth
    off_m = np.abs(guided.z_m - plane_m(guided.x_m))[np.isfinite(guided.z_m)]
    assert len(off_m) > 40 and off_m.max() < 0.004  # within half a period, 15 mm, of the prior's
    with pytest.raises(HandbenchError, match="kinect: the capture has no depths of this sensor"):
        Imager(native, "kinect", {}).images()


OTHER_LENS = entry("D0", FACTORY) | {"Intrinsics": {"ModelType": "Rational6KT"}}
REFUSED = {
    "no picture": ("depth/000000.png", b"no picture", "is not a readable photograph"),
    "8 bits": ("depth/000000.png", np.zeros((576, 640), np.uint8), "grey pixels of 16 bits"),
    "size": ("depth/000000.png", np.ones((576, 600), np.uint16), "does not fit its .*600"),
    "empty": ("depth/000000.png", np.zeros((576, 640), np.uint16), "sensor has no depth at the"),
    "no cameras": ("calibration.json", {}, "does not fit its calibration.json"),
    "lens": (
        "calibration.json",
        {"CalibrationInformation": {"Cameras": [OTHER_LENS, OTHER_LENS | {"Location": "PV0"}]}},
        "the lens model is Rational6KT",
    ),
}


@pytest.mark.parametrize(("file", "content", "reason"), REFUSED.values(), ids=REFUSED)
def test_files_that_are_not_the_sensor_s_are_refused(mine, file, content, reason):
    with pytest.raises(HandbenchError, match="has 2 depth pictures, but no frame 2"):
        found(mine, "kinect", 2)
    path = mine / "kinect" / file
    if isinstance(content, np.ndarray):
        cv2.imwrite(str(path), content)
    else:
        path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    with pytest.raises(HandbenchError, match=reason) as caught:
        found(mine, "kinect")
    assert "\n" not in str(caught.value)
