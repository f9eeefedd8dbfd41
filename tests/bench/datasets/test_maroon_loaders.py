"""An exported capture, opened as MAROON's public loaders open it: paths, keys, kinds of number, shapes and frames.

The reference is their code's use of the files, told here in our words with the file that it stands in; what their
loaders leave to a maker's library is computed after that library's source.
"""

import json
import os
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.maroon_export import export_maroon
from handbench.calibration.transforms import Transform
from handbench.groundtruth.cameras.metashape import read_metashape
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.radar.data.echoes_file import load_capture
from tests.bench.datasets.foreign_captures import PLACE_M, TONES_HZ, echoes, write_native

HALF_MM = 0.5  # what a depth in whole millimetres is off at most
PIXEL = 0.2 * 0.5 * 0.29 / 500  # depth over half a pixel of the photograph on the patch, which leans by 0.2; metres


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("set")
    native = write_native(folder / "native", echoes())
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec([0.3, -0.2, 2.0]).as_matrix(), (0.1, -0.05, 0.2)
    Transform("photo", "radar", matrix).save(native / "truth_radar_from_photo.json")
    return native, export_maroon(native, folder / "maroon", kinect=True)


@pytest.fixture(scope="module")
def calib(written):
    return json.loads((written[1] / "alignment.json").read_text())


def carried(points, src, dest, calib):
    """utils/spatial_alignment.py, transform: the pair's own matrix; README: row order, on columns [p, 1]."""
    matrix = np.array(calib[f"{src}2{dest}"]).reshape(4, 4)
    return (np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T)[:, :3]


def off_the_patch_m(points, calib, src):
    """How far points lie behind the patch's plane, by hand, along z of their radar frame (x to the right)."""
    x, y, z = carried(points, src, "radar", calib).T
    assert (np.abs(-x - PLACE_M[0]) < 0.0105).all() and (np.abs(y - PLACE_M[1]) < 0.0105).all()
    return z - (PLACE_M[2] + 0.2 * (-x - PLACE_M[0]))


def test_the_radar_loader_finds_its_frames(written):
    """sensors/radar_data_loader.py (get_config, load_calibrated_frame, read_radar_frames, get_timestamps) and the name
    that utils/visualization_utils.py (initialize_sensors) makes of the configuration."""
    native, maroon = written
    radar = maroon / f"radar_{float(72)}_{float(82)}_{len(TONES_HZ)}"
    volume = json.loads((radar / "calibration.json").read_text())["000000"]["volume"]
    for axis, n in zip(range(3), volume["grid_size"], strict=True):
        assert len(np.linspace(volume["bb_min"][axis], volume["bb_max"][axis], n)) == 11
    np.testing.assert_allclose(volume["bb_min"], PLACE_M * [-1, 1, 1] - 0.01, atol=1e-12)
    first = np.load(radar / "calibrated_data" / "000000.npy", allow_pickle=True).item()
    assert int(first.get("number_of_measurements")) == 2
    scale = json.loads((maroon / "metadata.json").read_text())["handbench_echo_scale"]
    assert np.log2(scale) == round(np.log2(scale))
    samples = load_capture(native / "echoes.h5").samples
    for number in range(2):
        content = np.load(radar / "calibrated_data" / f"{number:06d}.npy", allow_pickle=True).item()
        assert content.get("timestamp_us")[0].item() * 1e-6 == pytest.approx(0.1 * number)
        xr = content["xr"][1:95, 1:95, :]
        assert (content["xr"].dtype, content["xr"].shape) == (np.complex64, (96, 96, len(TONES_HZ)))
        np.testing.assert_array_equal(xr.transpose(2, 1, 0) / scale, samples[number])  # not a digit is lost
        np.testing.assert_array_equal(content.get("fvec"), TONES_HZ)


def test_the_photographs_loader_finds_mesh_camera_and_depth(written, calib):
    """sensors/camera_data_loader.py (__init__, load_images, load_calibration, get_image_data_from_idx, get_mesh) and
    utils/file_ops.py (load_rgb, load_depth, load_calibration)."""
    folder = written[1] / "photogrammetry"
    names = [os.path.splitext(name) for name in os.listdir(folder / "depth")]
    [name] = [stem for stem, suffix in names if suffix == ".tif"]
    rgb = cv2.imread(str(folder / "rgb" / f"{name}.jpg"), cv2.IMREAD_UNCHANGED)
    depth = cv2.imread(str(folder / "depth" / f"{name}.tif"), cv2.IMREAD_UNCHANGED)
    assert (depth.dtype, depth.ndim, rgb.shape) == (np.float32, 2, (*depth.shape, 3))
    mask = cv2.imread(str(folder / "mask" / f"{name}.png"))[:, :, 0]  # get_mesh
    np.testing.assert_array_equal(mask > 0, depth > 0)
    chunk = ElementTree.parse(folder / "cams.xml").getroot().findall("chunk")[0]
    sensors = chunk.findall("sensors")[0].findall("sensor")
    [camera] = [c for c in chunk.findall("cameras")[0].findall("camera") if c.get("label") == name]
    [lens] = [s.find("calibration") for s in sensors if s.get("id") == str(camera.get("sensor_id"))]
    w, h = (int(lens.find("resolution").get(side)) for side in ("width", "height"))
    assert (h, w) == depth.shape
    f, cx, cy = (float(lens.find(key).text) for key in ("f", "cx", "cy"))
    K = np.array([[f, 0, w / 2 + cx], [0, f, h / 2 + cy], [0, 0, 1]])
    pose = np.reshape(np.array(camera.find("transform").text.split(" ")), (-1, 4)).astype(float)
    whole = np.eye(4)
    whole[:3, :3] = np.array(chunk.find("transform").find("rotation").text.split(" "), float).reshape(3, 3)
    whole[:3, 3] = np.array(chunk.find("transform").find("translation").text.split(" "), float)
    v, u = np.nonzero(depth)
    pixels = np.stack([u, v, np.ones(len(u))]) * depth[v, u]
    points = (whole @ pose @ np.r_[np.linalg.inv(K) @ pixels, np.ones((1, len(u)))])[:3].T
    assert (
        np.abs(off_the_patch_m(points, calib, "photogrammetry")).max() < 1.5 * PIXEL
    )  # they count pixels from 0, not ½
    mesh = folder / "mesh_masked.obj"
    vertices = np.array([line.split()[1:4] for line in mesh.read_text().splitlines() if line.startswith("v ")], float)
    np.testing.assert_array_equal(vertices, read_triangles(mesh)[0])
    assert np.abs(off_the_patch_m(vertices, calib, "photogrammetry")).max() < 1e-8


def test_our_own_reader_agrees_about_the_camera(written):
    [camera] = read_metashape(written[1] / "photogrammetry" / "cams.xml")
    depth = cv2.imread(str(written[1] / "photogrammetry" / "depth" / f"{camera.name}.tif"), cv2.IMREAD_UNCHANGED)
    v, u = np.nonzero(depth)
    points = camera.centre_m + camera.directions(np.stack([u, v], axis=1) + 0.5) * (
        depth[v, u] / (camera.directions(np.stack([u, v], axis=1) + 0.5) @ camera.rotation[2])
    ).reshape(-1, 1)
    x_m, _, z_m = open_capture(written[1]).transform().points(points).T
    assert np.abs(z_m - (PLACE_M[2] + 0.2 * (x_m - PLACE_M[0]))).max() < 1e-6


def kinect_lens(camera, binned, corner):
    """fx, fy, cx, cy with the first pixel's centre at 0 (Azure Kinect SDK, mode_specific_calibration.c)."""
    cx, cy, fx, fy = camera["Intrinsics"]["ModelParameters"][:4]
    assert not any(camera["Intrinsics"]["ModelParameters"][4:14])
    return fx * binned[0], fy * binned[1], cx * binned[0] - corner[0] - 0.5, cy * binned[1] - corner[1] - 0.5


def test_the_kinect_loader_finds_cameras_masks_and_times(written, calib):
    """sensors/kinect_data_loader.py (get_timestamps, num_frames, get_frame, get_ir_image, project_depth_to_3d): depth
    16 bits, in the space "depth" (main.py); masks and colours of 1080p. The SDK wants the keys that its calibration.c
    reads (fill_in_camera_cal_data)."""
    folder = written[1] / "kinect"
    assert calib["kinect_calib"]["space"] == "depth"  # else initialize_sensors corrects the matrices
    known = json.loads((folder / "calibration.json").read_text())["CalibrationInformation"]["Cameras"]
    cameras = {camera["Location"]: camera for camera in known}
    for camera in cameras.values():
        assert {"Intrinsics", "Rt", "SensorHeight", "SensorWidth", "MetricRadius"} <= camera.keys()
        assert camera["Intrinsics"]["ModelParameterCount"] == len(camera["Intrinsics"]["ModelParameters"]) == 14
    depth_camera, colour = (cameras[f"CALIBRATION_CameraLocation{place}"] for place in ("D0", "PV0"))
    assert (depth_camera["SensorWidth"], depth_camera["SensorHeight"]) == (1024, 1024)
    assert colour["SensorWidth"] * 3 // 4 == colour["SensorHeight"]
    frames = [name for name in os.listdir(folder / "rgb") if ".png" in name]
    lines = (folder / "timestamps.txt").read_text().splitlines()[1:]
    assert len(frames) == len(lines) == 2
    assert [np.uint64(line.split(" ")[3]) * 1e-9 for line in lines] == [0.0, pytest.approx(0.1)]
    kinds = ("depth", "ir", "mask", "rgb")
    read = {kind: cv2.imread(str(folder / kind / "000001.png"), cv2.IMREAD_UNCHANGED) for kind in kinds}
    assert (read["depth"].dtype, read["depth"].shape) == (np.uint16, (576, 640)) == (read["ir"].dtype, read["ir"].shape)
    assert (read["mask"].shape, read["rgb"].shape) == ((1080, 1920), (1080, 1920, 3))
    fx, fy, cx, cy = kinect_lens(depth_camera, (1024, 1024), (192, 180))
    v, u = np.nonzero(read["depth"])
    z_mm = read["depth"][v, u].astype(float)
    points_mm = np.stack([(u - cx) / fx * z_mm, (v - cy) / fy * z_mm, z_mm], axis=1)
    off_mm = 1e3 * off_the_patch_m(points_mm, calib, "kinect")
    assert np.abs(off_mm).max() < 1.05 * HALF_MM  # the patch leans: rounded along the ray, seen along z
    assert np.abs(off_mm).mean() > 0.1  # rounded it is
    fx, fy, cx, cy = kinect_lens(colour, (1920, 1440), (0, 180))
    places = np.round([fx * points_mm[:, 0] / z_mm + cx, fy * points_mm[:, 1] / z_mm + cy]).astype(int)
    assert (read["mask"][places[1], places[0]] > 0).mean() > 0.97  # but for the patch's edge
    assert 0.9 < (read["mask"] > 0).sum() / (len(u) * (900 / 504) ** 2) < 1.1


def test_every_matrix_that_they_ask_for_is_there(calib):
    """utils/spatial_alignment.py (transform, to_world): each pair, and the world, whose axes are the radar's."""
    point = np.array([[0.01, 0.02, 0.3]])
    for src in ("radar", "photogrammetry", "kinect"):
        for dest in {"radar", "photogrammetry", "kinect"} - {src}:
            there = carried(point, src, dest, calib)
            np.testing.assert_allclose(
                carried(there, dest, "world", calib), carried(point, src, "world", calib), atol=1e-9
            )
    np.testing.assert_array_equal(calib["radar2world"], np.eye(4))
    assert np.cbrt(abs(np.linalg.det(np.array(calib["kinect2world"])[:3, :3]))) == pytest.approx(1e-3)  # of millimetres


def test_exact_echoes_are_as_they_were(written, tmp_path):
    folder = export_maroon(written[0], tmp_path, exact=True)
    content = np.load(next(folder.glob("radar_*/calibrated_data/000000.npy")), allow_pickle=True).item()
    expected = load_capture(written[0] / "echoes.h5").samples[0]
    np.testing.assert_array_equal(content["xr"][1:95, 1:95].transpose(2, 1, 0), expected)
