"""Metashape's camera export, against its manual's formulas written anew."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.groundtruth.camera_files import read_metashape
from tests.refusals import refuse

WIDTH, HEIGHT = 640, 480
LENS = {"f": 700.0, "cx": 5.5, "cy": -3.25, "b1": 1.5, "k1": -0.08, "k2": 0.05, "k3": -0.02}
LENS |= {"p1": 8e-4, "p2": -5e-4}
CAMERA_TO_CHUNK = np.eye(4)
CAMERA_TO_CHUNK[:3, :3] = Rotation.from_euler("xyz", (170, 10, -20), degrees=True).as_matrix()
CAMERA_TO_CHUNK[:3, 3] = (0.7, -1.1, 9.0)
TURN = Rotation.from_euler("xyz", (-60, 30, 15), degrees=True).as_matrix()
SCALE, SHIFT_M = 0.05, np.array([10.0, 20.0, -3.0])


def words(numbers):
    return " ".join(repr(float(number)) for number in np.ravel(numbers))


WORLD = (
    f"<transform><rotation locked='true'>{words(TURN)}</rotation><translation locked='true'>"
    f"{words(SHIFT_M)}</translation><scale locked='true'>{SCALE}</scale></transform>"
)


def export(path, world=WORLD, label="DSC_1"):
    """A file as Metashape 2 writes it; one camera is not aligned."""
    size = f"<resolution width='{WIDTH}' height='{HEIGHT}'/>"
    calibration = "".join(f"<{name}>{value!r}</{name}>" for name, value in LENS.items())
    path.write_text(
        f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true">
  <sensors next_id="1"><sensor id="0" label="unknown" type="frame">
    {size}<property name="layer_index" value="0"/>
    <calibration type="frame" class="initial">{size}<f>1</f></calibration>
    <calibration type="frame" class="adjusted">{size}{calibration}</calibration>
  </sensor></sensors>
  <components><component id="0" label="Part">{world}</component></components>
  <cameras next_id="2"><group id="0" label="Group 1" type="folder">
    <camera id="0" sensor_id='0' component_id="0" label="{label}">
      <transform>{words(CAMERA_TO_CHUNK)}</transform><orientation>1</orientation></camera>
    <camera id="1" sensor_id='0' label="DSC_2"/>
  </group></cameras></chunk></document>""",
        encoding="utf-8",
    )
    return path


def by_the_manual(points_m):
    """Pixels [n, 2] of world points, by Metashape's user manual, appendix on camera models."""
    chunk = ((points_m - SHIFT_M) @ TURN) / SCALE
    X, Y, Z = (np.linalg.inv(CAMERA_TO_CHUNK) @ np.c_[chunk, np.ones(len(chunk))].T)[:3]
    x, y = X / Z, Y / Z
    r = np.hypot(x, y)
    c = LENS
    radial = 1 + c["k1"] * r**2 + c["k2"] * r**4 + c["k3"] * r**6
    xd = x * radial + (c["p1"] * (r**2 + 2 * x**2) + 2 * c["p2"] * x * y)
    yd = y * radial + (c["p2"] * (r**2 + 2 * y**2) + 2 * c["p1"] * x * y)
    u = WIDTH * 0.5 + c["cx"] + xd * c["f"] + xd * c["b1"]
    return np.stack([u, HEIGHT * 0.5 + c["cy"] + yd * c["f"]], axis=1)


def test_a_camera_projects_as_the_manual_says(tmp_path):
    aligned, other = read_metashape(export(tmp_path / "cams.xml"))
    assert (aligned.name, aligned.width, aligned.height) == ("DSC_1", WIDTH, HEIGHT)
    in_camera = np.random.default_rng(0).uniform((-3, -2, 8), (3, 2, 12), (50, 3))
    in_chunk = in_camera @ CAMERA_TO_CHUNK[:3, :3].T + CAMERA_TO_CHUNK[:3, 3]
    points_m = SCALE * in_chunk @ TURN.T + SHIFT_M
    np.testing.assert_allclose(aligned.project(points_m), by_the_manual(points_m), atol=1e-8)
    assert other.name == "DSC_2" and other.R is None and other.t is None


def test_without_a_scale_there_are_no_poses_and_labels_may_be_paths(tmp_path):
    for label in ("C:\\photos\\a.JPG", "/home/b/a.JPG"):
        cameras = read_metashape(export(tmp_path / "cams.xml", world="", label=label))
        assert cameras[0].name == "a.JPG" and not any(camera.posed for camera in cameras)


@pytest.mark.parametrize(
    ("find", "put", "place"),
    [
        ("<f>", "<k4>0.1</k4><f>", "k4"),
        ("<f>", "<b2>0.147</b2><f>", "b2"),  # 0.05 px at the picture's edge, 240 px off
        ("<f>700.0", "<f>nan", "nan"),
        ("</document>", "", "XML"),
        ("frame", "fisheye", "frame"),
        ("sensor_id='0'", "sensor_id='9'", "9"),
        ("chunk", "piece", "0 Metashape chunks"),
        ("<transform>", "<transform>7 ", "17 numbers"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path, find, put, place):
    path = export(tmp_path / "cams.xml")
    path.write_text(path.read_text("utf-8").replace(find, put), encoding="utf-8")
    refuse(lambda: read_metashape(path), str(path), place)
