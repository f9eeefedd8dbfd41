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
from handbench.bench.datasets.maroon_alignment import kinect_camera, save_alignment
from handbench.bench.run.reconstruct_stage import Imager
from handbench.calibration.transforms import Transform
from handbench.cli.main import main
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from tests.bench.datasets.foreign_captures import PIXELS, PLACE_M, echoes, write_native
from tests.bench.datasets.maroon_writer import write_maroon

GRID = PixelGrid(np.linspace(-0.038, -0.022, 9), np.linspace(0.012, 0.028, 9))
ROUNDED_M = 0.5e-3 * 1.1  # depths are whole millimetres; the plane leans by 0.2
FACING = np.diag([-1.0, -1.0, 1.0])  # sensors that look along the radar's z: x to the right, y down
PLACE = np.array([-0.02, 0.01, 0.0])  # of every sensor


def plane_m(x_m):
    return PLACE_M[2] + 0.2 * (x_m - PLACE_M[0])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sensors")
    native = write_native(folder / "native", echoes(2))
    return native, write_maroon(native, folder / "maroon", kinect=True)


@pytest.fixture
def mine(written, tmp_path):
    return shutil.copytree(written[1], tmp_path / "maroon" / "patch" / "30")


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


def align(folder, name, unit_m=1e-3, axes=FACING, place=PLACE):
    """Put a sensor's matrix into alignment.json; its points are multiples of unit_m."""
    calib = json.loads((folder / "alignment.json").read_text())
    calib[f"{name}2radar"] = (
        np.diag([-1, 1, 1, 1]) @ np.r_[np.c_[unit_m * axes.T, place], [[0, 0, 0, 1]]]
    ).tolist()
    (folder / "alignment.json").write_text(json.dumps(calib))


def found(folder, name, frame=0):
    x, y = (
        {"start_m": axis[0], "stop_m": axis[-1], "step_m": 0.002} for axis in (GRID.x_m, GRID.y_m)
    )
    chosen = method(name)
    return chosen.run(
        open_capture(folder).echoes(), chosen.configure({"x": x, "y": y}, "test"), frame
    ).depth.z_m


LENS = {"fx": 400.0, "fy": 400.0, "cx": 250.3, "cy": 180.7}


@pytest.mark.parametrize(("name", "side"), [("realsense", ""), ("zed", "left/")])
def test_stereo_cameras(mine, name, side):
    """sensors/realsense_data_loader.py and zed_data_loader.py: xyz = K⁻¹ (u z, v z, z), pixels
    counted from 0."""
    depth = np.round(depth_mm(rays_of(500, 360, 400.0, 250.3, 180.7))).astype(np.uint16)
    write(
        mine,
        name,
        {f"depth/{side}000000.png": depth},
        {"rgb" if name == "realsense" else "left": LENS},
    )
    align(mine, name)
    z_m = found(mine, name)
    np.testing.assert_allclose(z_m, np.broadcast_to(plane_m(GRID.x_m), z_m.shape), atol=ROUNDED_M)
    assert (
        abs((z_m - plane_m(GRID.x_m)).mean()) < 0.1e-3
    )  # and not half a pixel aside, which were 0.07 mm by the lean
    align(mine, name, unit_m=1.0)  # a matrix from metres
    np.testing.assert_allclose(found(mine, name), z_m, atol=1e-9)
    align(mine, name, unit_m=0.01)
    with pytest.raises(HandbenchError, match=r"scales by 0\.01; expected 0\.001 or 1"):
        found(mine, name)


def test_the_scale_and_the_mask_of_a_realsense(mine):
    """Counts of a tenth of a millimetre; the last frame's mask leaves the picture's right half: our
    smaller x."""
    rays = rays_of(500, 360, 400.0, 250.3, 180.7)
    mask = np.zeros((360, 500), np.uint8)
    u = 250.3 + 400 * (PLACE[0] - PLACE_M[0]) / PLACE_M[2]  # where x = PLACE_M[0] is seen
    mask[:, int(u) + 2 :] = 255
    write(mine, "realsense", {"depth/000000.png": np.round(10 * depth_mm(rays)).astype(np.uint16),
                              "mask/000000.png": 255 - mask, "mask/000003.png": mask},
          {"capture": {"scale": 1e-4}, "rgb": LENS})  # fmt: skip
    align(mine, "realsense")
    z_m = found(mine, "realsense")
    np.testing.assert_allclose(
        z_m[:, :3], np.broadcast_to(plane_m(GRID.x_m[:3]), (9, 3)), atol=0.06e-3
    )
    assert np.isnan(z_m[:, 5:]).all()


FACTORY = [
    0.51,
    0.47,
    0.49,
    0.5,
    0.3,
    -0.2,
    0.1,
    0.4,
    -0.1,
    0.05,
    0,
    0,
    4e-4,
    -3e-4,
]  # cx cy fx fy k1…k6 · · p2 p1


def seen_by(factory, binned, corner, points):
    """Pixels of points, the first one's centre at 0: the SDK's transform with the lens that it
    calls Brown–Conrady (mode_specific_calibration.c, intrinsic_transformation.c)."""
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = factory
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r2 = x * x + y * y
    d = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u = x * d + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * d + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
    return u * fx * binned[0] + cx * binned[0] - corner[0] - 0.5, v * fy * binned[1] + cy * binned[
        1
    ] - corner[1] - 0.5


def test_a_kinect_s_lens_bends_as_its_maker_s_does():
    """Terms of each kind, strong enough to be told apart; the first pixel's centre is at ½ with
    us."""
    strong = [0.51, 0.47, 0.49, 0.5, 0.3, -0.2, 0.1, 0.4, -0.1, 0.05, 0, 0, 0.02, -0.03]
    entry = {"Location": "CALIBRATION_CameraLocationD0", "Intrinsics": {"ModelParameters": strong,
             "ModelType": "CALIBRATION_LensDistortionModelBrownConrady"}}  # fmt: skip
    points = np.random.default_rng(3).uniform([-0.2, -0.2, 0.5], [0.2, 0.2, 1.0], (20, 3))
    expected = np.stack(seen_by(strong, (1024, 1024), (192, 180), points), axis=1) + 0.5
    np.testing.assert_allclose(
        kinect_camera(entry).colmap().img_from_cam(points), expected, atol=1e-9
    )


def test_steps_of_more_than_a_centimetre_are_not_joined(mine):
    depth = np.full((360, 500), 300, np.uint16)
    depth[:, 200:300], depth[:, 300:] = 309, 320
    write(mine, "realsense", {"depth/000000.png": depth}, {"rgb": LENS})
    align(mine, "realsense")
    vertices, faces = open_capture(mine).sensors()["realsense"].triangles()
    spans_mm = np.ptp(vertices[faces][..., 2], axis=1)
    assert set(spans_mm.round(9)) == {0.0, 9.0}
    assert len(faces) == 2 * 359 * 498  # all quads but a column


@pytest.mark.parametrize("space", ["depth", "color"])
def test_a_kinect_with_its_lenses(mine, space):
    """A picture with depths at the pixels nearest to a net of points of the plane; the colour
    camera stands 32 mm aside and is turned, its mask has a hole, and the matrix is of the frame
    that kinect_calib names."""
    shutil.rmtree(mine / "kinect")
    x, y = (
        axis.ravel()
        for axis in np.meshgrid(np.arange(-0.05, -0.01, 0.0002), np.arange(0, 0.04, 0.0002))
    )
    points_mm = 1e3 * (np.stack([x, y, plane_m(x)], axis=1) - PLACE) @ FACING.T
    u, v = np.round(seen_by(FACTORY, (1024, 1024), (192, 180), points_mm)).astype(int)
    depth = np.zeros((576, 640), np.uint16)
    depth[v, u] = np.round(points_mm[:, 2])
    rotation, _ = cv2.Rodrigues(np.array([0.05, -0.02, 0.01]))
    shift_m = np.array([-0.032, -0.002, 0.004])
    raw = [0.5, 0.51, 0.478, 0.637, 0.33, -2.4, 1.4, 0.2, -2.3, 1.3, 0, 0, -1e-4, -2e-4]
    hole = np.array([[0.002, 0.004]]) + np.array([[-0.030, 0.020]])
    edges = np.array([[dx, dy] for dx in (-0.003, 0.003) for dy in (-0.003, 0.003)]) + hole
    corners = np.c_[edges, plane_m(edges[:, 0])]
    in_colour = 1e3 * ((corners - PLACE) @ FACING.T @ rotation.T + shift_m)
    mask = np.full((1080, 1920), 255, np.uint8)
    places = np.round(np.stack(seen_by(raw, (1920, 1440), (0, 180), in_colour), axis=1)).astype(
        np.int32
    )
    cv2.fillConvexPoly(mask, cv2.convexHull(places), 0)
    still = {"Rotation": np.eye(3).ravel().tolist(), "Translation": [0, 0, 0]}
    moved = {"Rotation": rotation.ravel().tolist(), "Translation": shift_m.tolist()}
    lens = "CALIBRATION_LensDistortionModelBrownConrady"
    cameras = [
        {
            "Location": f"CALIBRATION_CameraLocation{place}",
            "Rt": rt,
            "Intrinsics": {"ModelParameters": parameters, "ModelType": lens},
        }
        for place, rt, parameters in (("D0", still, FACTORY), ("PV0", moved, raw))
    ]
    write(mine, "kinect", {"depth/000000.png": depth, "mask/000000.png": mask},
          {"CalibrationInformation": {"Cameras": cameras}})  # fmt: skip
    if space == "depth":
        align(mine, "kinect")
    else:  # p_radar = M (R p + t): the colour camera's own place
        align(mine, "kinect", axes=rotation @ FACING, place=PLACE - FACING.T @ rotation.T @ shift_m)
    calib = json.loads((mine / "alignment.json").read_text())
    calib["kinect_calib"] = (
        {"space": space} if space == "depth" else {}
    )  # their default is the colour camera
    (mine / "alignment.json").write_text(json.dumps(calib))
    z_m = found(mine, "kinect")
    near = np.abs(np.stack(np.meshgrid(GRID.x_m, GRID.y_m), axis=-1) - hole[0]).max(axis=-1)
    assert np.isnan(z_m[near < 0.002]).all() and np.isfinite(z_m[near > 0.005]).all()
    off_m = (z_m - plane_m(GRID.x_m))[near > 0.005]
    assert (
        np.abs(off_m).max() < ROUNDED_M + 0.1e-3
    )  # a net's point lies up to half a pixel beside the pixel's centre
    assert np.abs(off_m.mean()) < 0.05e-3


def test_a_rendered_kinect_is_scored_beside_the_radar_and_guides_it(written):
    native, maroon = written
    kinect = Imager(maroon, "kinect", {}).images().results[0].depth
    assert (
        kinect.x_m == method("2fsk").configure({**PIXELS}, "test").grid().x_m
    ).all()  # on the capture's own pixels
    np.testing.assert_allclose(
        kinect.z_m[1:-1, 1:-1], np.broadcast_to(plane_m(kinect.x_m[1:-1]), (9, 9)), atol=ROUNDED_M
    )
    guided = Imager(maroon, "prior-2fsk", {"prior": "kinect"}).images().results[0].depth
    both = np.isfinite(guided.z_m)
    assert both.sum() > 40
    assert (
        np.abs(guided.z_m - plane_m(guided.x_m))[both].max() < 0.004
    )  # within half a period, 15 mm, of the prior's
    with pytest.raises(
        HandbenchError,
        match="kinect: the capture holds no depth of that sensor, but the radar's alone",
    ):
        Imager(native, "kinect", {}).images()


def test_a_sensor_has_no_trust_of_the_radar_s(written, tmp_path):
    assert (
        main(
            [
                "reconstruct",
                str(written[1]),
                "--method",
                "kinect",
                "-o",
                str(tmp_path / "kinect.npz"),
            ]
        )
        == 0
    )
    with np.load(tmp_path / "kinect.npz") as file:
        assert "p_gross" not in file
        assert (np.isfinite(file["amplitude_db"]) == np.isfinite(file["z_m"])).all()


def test_a_benchmark_runs_on_without_the_sensor(written, capsys, tmp_path):
    bench = written[0].parent / "bench.toml"
    bench.write_text('version = 1\nname = "b"\n[[capture]]\npath = "native"\n[[method]]\nid = '
                     '"zed"\n'
                     '[[method]]\nid = "2fsk"\n')  # fmt: skip
    assert main(["run", str(bench), "-o", str(tmp_path / "run")]) == 0
    assert "zed: the capture holds no depth of that sensor" in capsys.readouterr().err
    assert "2fsk" in (tmp_path / "run" / "table.csv").read_text()


def test_the_key_minds_what_is_read_of_the_sensors(mine):
    before = open_capture(mine).key(1)
    (mine / "kinect" / "depth" / "000001.png").write_bytes(b"not among the first frames")
    (mine / "kinect" / "rgb" / "000000.png").write_bytes(b"not read")
    assert open_capture(mine).key(1) == before
    for file in ("calibration.json", "depth/000000.png", "mask/000001.png"):
        kept = (mine / "kinect" / file).read_bytes()
        (mine / "kinect" / file).write_bytes(kept + b" ")
        assert open_capture(mine).key(1) != before, file
        (mine / "kinect" / file).write_bytes(kept)


@pytest.mark.parametrize(
    ("file", "content", "reason"),
    [
        ("depth/000000.png", b"no picture", "is not a readable photograph"),
        (
            "depth/000000.png",
            np.zeros((576, 640), np.uint8),
            "has pixels of mode L; expected grey ones of 16 bits",
        ),
        (
            "depth/000000.png",
            np.ones((576, 600), np.uint16),
            "does not fit its calibration.json .*600",
        ),
        ("depth/000000.png", np.zeros((576, 640), np.uint16), "saw nothing at the radar's pixels"),
        ("calibration.json", b"{}", "does not fit its calibration.json"),
        ("calibration.json", b"[]", "holds no table"),
        (
            "calibration.json",
            b'{"CalibrationInformation": {"Cameras": 3}}',
            "does not fit its calibration.json",
        ),
        ("mask/000001.png", b"no picture", "mask/000001.png: is not a readable photograph"),
    ],
)
def test_files_that_are_not_the_sensor_s_are_refused(mine, file, content, reason):
    path = mine / "kinect" / file
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        cv2.imwrite(str(path), content)
    with pytest.raises(HandbenchError, match=reason) as caught:
        found(mine, "kinect")
    assert "\n" not in str(caught.value)


def test_another_lens_and_a_missing_frame_are_refused(mine):
    with pytest.raises(HandbenchError, match="has 2 depth pictures, but no frame 2"):
        found(mine, "kinect", 2)
    calibration = mine / "kinect" / "calibration.json"
    calibration.write_text(calibration.read_text().replace("BrownConrady", "Rational6KT"))
    with pytest.raises(
        HandbenchError, match="the lens is CALIBRATION_LensDistortionModelRational6KT"
    ):
        found(mine, "kinect")


def test_a_sensor_without_a_matrix_is_none(mine):
    (mine / "alignment.json").unlink()
    save_alignment(mine / "alignment.json", Transform("photo", "radar", np.eye(4)))
    assert not open_capture(mine).echoes().sensors
