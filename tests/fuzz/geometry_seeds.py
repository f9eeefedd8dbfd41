"""Small valid inputs of the readers of shapes, places, cameras and pictures, each written into an
empty folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from handbench.calibration.spheres.description import default_target, save_target
from handbench.calibration.transforms import Transform
from handbench.groundtruth.board.board import Board, save_board
from handbench.groundtruth.cameras.cameras import Camera, load_pycolmap, save_cameras
from handbench.groundtruth.mesh.mesh_files import load_open3d, mesh
from handbench.groundtruth.mesh.surface import Surface
from handbench.groundtruth.photos.photos import Photo
from handbench.radar.data.depthmap import DepthMap

if TYPE_CHECKING:
    import pycolmap

POINTS_M = np.array([[0.01, -0.02, 0.30], [-0.03, 0.0, 0.29], [0.0, 0.04, 0.31]])
CORNERS_M = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
NAMES, SIZE = ("a.jpg", "b.png", "d.png"), (40, 30)  # photographs, of this width and height
AXIS_M = np.linspace(-0.02, 0.02, 5)
SENSOR = (
    '<document version="2.0.0"><chunk label="Chunk 1" enabled="true"><sensors next_id="1">'
    '<sensor id="0" label="unknown" type="frame"><resolution width="40" height="30"/>'
    '<calibration type="frame" class="adjusted"><resolution width="40" height="30"/><f>44.0</f>'
    "<cx>0.5</cx><cy>-0.25</cy><b1>0.1</b1><k1>-0.08</k1><p1>8e-4</p1></calibration></sensor>"
    '</sensors><components><component id="0"><transform><rotation>1 0 0 0 1 0 0 0 1</rotation>'
    "<translation>10.0 20.0 -3.0</translation><scale>0.05</scale></transform></component>"
    '</components><cameras next_id="3"><group id="0">'
)


def radar_from_photo() -> Transform:
    """A transform with all that it can tell."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    matrix[:3, 3] = (0.1, 0.2, 0.5)
    return Transform("photo", "radar", matrix, np.diag([1e-8] * 6), np.array([1e-4, 2e-4]))


def places(folder: Path) -> None:
    """The calibration target, a board of markers and a ChArUco board, and a transform."""
    save_target(folder / "target.toml", default_target())
    corners_m = [(0, 0, 0), (0.02, 0, 0), (0.02, -0.02, 0), (0, -0.02, 0)]
    marker = [{"id": 3, "corners_m": corners_m}]
    charuco = {"columns": 5, "rows": 4, "square_m": 0.03, "marker_m": 0.02}
    board = Board(dictionary="DICT_5X5_50", marker=marker, charuco=charuco)
    save_board(folder / "board.toml", board)
    radar_from_photo().save(folder / "radar_from_photo.json")


def photos(folder: Path) -> tuple[Photo, ...]:
    """Photographs that need not be there, of which the last is held upright."""
    turned = (1, 1, 6)
    return tuple(
        Photo(folder / name, name, *SIZE, orientation=way)
        for name, way in zip(NAMES, turned, strict=True)
    )


def cameras(folder: Path) -> None:
    """cameras.json, of which the last camera is of the upright picture, and turned back;
    Metashape's export of three cameras; COLMAP's models, binary and text."""
    eye, found, views = np.eye(3).tolist(), [], ""
    for k, (name, (w, h)) in enumerate(zip(NAMES, (SIZE, SIZE, SIZE[::-1]), strict=True)):
        params = (44.0, 44.1, w / 2, h / 2, -0.05, 0.01, 1e-3, 1e-3)
        pose = {"R": eye, "t": (0.1 * k, 0.0, 0.5)}
        found.append(Camera(name=name, width=w, height=h, params=params, **pose))
        views += (
            f'<camera id="{k}" sensor_id="0" component_id="0" label="{name[0]}"><transform>'
            "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform><orientation>1</orientation></camera>"
        )
    save_cameras(folder / "cameras.json", tuple(found))
    head, tail = '<?xml version="1.0" encoding="UTF-8"?>\n', "</group></cameras></chunk></document>"
    (folder / "cams.xml").write_text(f"{head}{SENSOR}{views}{tail}")
    for kind in ("sparse", "text"):
        (folder / kind).mkdir()
    colmap_model().write_binary(folder / "sparse")
    colmap_model().write_text(folder / "text")


def colmap_model() -> pycolmap.Reconstruction:
    """A model of `photos`, of points that all of them see."""
    library, points_m = load_pycolmap(), np.random.default_rng(0).uniform(-0.2, 0.2, (22, 3))
    model, (width, height) = library.Reconstruction(), SIZE
    params = [44, 44, 20, 15, 0, 0, 0, 0]
    camera = library.Camera(camera_id=1, model="OPENCV", width=width, height=height, params=params)
    model.add_camera_with_trivial_rig(camera)
    for k, name in enumerate(NAMES):
        pose = library.Rigid3d(library.Rotation3d(np.eye(3)), np.array([0.1 * k, 0, 1.0]))
        pixels = np.asarray(model.cameras[1].img_from_cam(pose * points_m))
        image = library.Image(name, [library.Point2D(pixel) for pixel in pixels], 1, k + 1)
        model.add_image_with_trivial_frame(image, pose)
    for number, point_m in enumerate(points_m):
        track = library.Track([library.TrackElement(k + 1, number) for k in range(len(NAMES))])
        model.add_point3D(point_m, track, np.zeros(3, np.uint8))
    return model


def meshes(folder: Path) -> None:
    """A tetrahedron in every form."""
    Surface(CORNERS_M, FACES, np.full(4, 1e-4), np.ones(4, np.uint8)).save(folder / "mesh.ply")
    shape, write = mesh(CORNERS_M, FACES), load_open3d().io.write_triangle_mesh
    shape.compute_vertex_normals()
    for name in ("mesh.obj", "mesh.stl", "text.ply"):
        write(str(folder / name), shape, write_ascii=name == "text.ply")


def depth(folder: Path) -> None:
    """A depth map with all that it can tell."""
    z_m = np.where(np.add.outer(AXIS_M, AXIS_M) > 0.02, np.nan, 0.3)
    layers = {"sigma_m": z_m * 1e-3, "wrapped": z_m > 0.4}
    amplitude_db = np.where(z_m > 0, 0.0, -6.0)
    found = DepthMap(AXIS_M, AXIS_M, z_m, amplitude_db, "2fsk", {"f1_hz": 82e9}, **layers)
    found.save(folder / "depth.npz")


def pictures(folder: Path) -> None:
    """Photographs in every form, the first with EXIF data, and masks."""
    values = np.random.default_rng(1).integers(0, 255, (SIZE[1], SIZE[0], 3), np.uint8)
    picture, exif = Image.fromarray(values), Image.Exif()
    exif[0x0110], exif[0x0112] = "Camera", 6
    lens = {0x920A: 35.0, 0xA405: 50, 0xA20E: 1000.0, 0xA210: 2, 0xA002: SIZE[0]}
    exif.get_ifd(0x8769).update(lens)
    picture.save(folder / "a.jpg", exif=exif, quality=60)
    picture.save(folder / "b.png")
    Image.fromarray(np.arange(1200, dtype=np.uint16).reshape(30, 40)).save(folder / "c.tif")
    picture.convert("P").save(folder / "d.png")
    (folder / "masks").mkdir()
    grey = picture.convert("L")
    for name in ("a.jpg.png", "b.png", "d.png"):
        turned = grey.rotate(90, expand=True) if name == "d.png" else grey
        turned.save(folder / "masks" / name)
