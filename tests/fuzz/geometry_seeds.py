"""Small valid inputs of the readers of shapes, places and cameras, each written into an empty
folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pycolmap

    from handbench.calibration.transforms import Transform
    from handbench.groundtruth.photos.photos import Photo

POINTS_M = np.array([[0.01, -0.02, 0.30], [-0.03, 0.0, 0.29], [0.0, 0.04, 0.31]])
CORNERS_M = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
NAMES, SIZE = ("a.jpg", "b.png", "d.png"), (40, 30)  # photographs, of this width and height
AXIS_M = np.linspace(-0.02, 0.02, 5)


def target(folder: Path) -> None:
    """The calibration target."""
    from handbench.calibration.spheres.description import default_target, save_target

    save_target(folder / "target.toml", default_target())


def board(folder: Path) -> None:
    """Markers and a ChArUco board."""
    from handbench.groundtruth.board.board import Board, save_board

    corners_m = [(0, 0, 0), (0.02, 0, 0), (0.02, -0.02, 0), (0, -0.02, 0)]
    save_board(
        folder / "board.toml",
        Board(
            dictionary="DICT_5X5_50",
            marker=[{"id": 3, "corners_m": corners_m}],
            charuco={"columns": 5, "rows": 4, "square_m": 0.03, "marker_m": 0.02},
        ),
    )


def radar_from_photo() -> Transform:
    """A transform with all that it can tell."""
    from scipy.spatial.transform import Rotation

    from handbench.calibration.transforms import Transform

    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = (
        Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(),
        (0.1, 0.2, 0.5),
    )
    return Transform("photo", "radar", matrix, np.diag([1e-8] * 6), np.array([1e-4, 2e-4]))


def transform(folder: Path) -> None:
    """radar_from_photo with its covariance."""
    radar_from_photo().save(folder / "radar_from_photo.json")


def alignment(folder: Path) -> None:
    """The same as MAROON writes it."""
    from handbench.bench.datasets.maroon_alignment import save_alignment

    save_alignment(folder / "alignment.json", radar_from_photo())


def photos(folder: Path) -> tuple[Photo, ...]:
    """Photographs that need not be there, of which the last is held upright."""
    from handbench.groundtruth.photos.photos import Photo

    return tuple(
        Photo(folder / name, name, *SIZE, orientation=6 if name == "d.png" else 1) for name in NAMES
    )


def cameras(folder: Path) -> None:
    """cameras.json: the last camera is of the upright picture, and turned back."""
    from handbench.groundtruth.cameras.cameras import Camera, save_cameras

    sizes = (SIZE, SIZE, SIZE[::-1])
    save_cameras(
        folder / "cameras.json",
        tuple(
            Camera(
                name=name,
                width=w,
                height=h,
                params=(44.0, 44.1, w / 2, h / 2, -0.05, 0.01, 1e-3, 1e-3),
                R=np.eye(3).tolist(),
                t=(0.1 * k, 0.0, 0.5),
            )
            for k, (name, (w, h)) in enumerate(zip(NAMES, sizes, strict=True))
        ),
    )


def metashape(folder: Path) -> None:
    """Metashape's export of three cameras."""

    def words(values: np.ndarray) -> str:
        return " ".join(repr(float(value)) for value in np.ravel(values))

    views = "".join(
        f'<camera id="{k}" sensor_id="0" component_id="0" '
        f'label="{Path(name).stem}"><transform>{words(np.eye(4))}'
        "</transform><orientation>1</orientation></camera>"
        for k, name in enumerate(NAMES)
    )
    (folder / "cams.xml").write_text(f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true">
<sensors next_id="1"><sensor id="0" label="unknown" type="frame"><resolution width="{SIZE[0]}" height="{SIZE[1]}"/>
<calibration type="frame" class="adjusted"><resolution width="{SIZE[0]}" height="{SIZE[1]}"/>
<f>44.0</f><cx>0.5</cx><cy>-0.25</cy><b1>0.1</b1><k1>-0.08</k1><k2>0.05</k2><k3>-0.02</k3><p1>8e-4</p1><p2>-5e-4</p2>
</calibration></sensor></sensors>
<components><component id="0"><transform><rotation>{words(np.eye(3))}</rotation>
<translation>10.0 20.0 -3.0</translation><scale>0.05</scale></transform></component></components>
<cameras next_id="3"><group id="0">{views}</group></cameras></chunk></document>""")


def colmap_model() -> pycolmap.Reconstruction:
    """A model of `photos`, of points that all of them see."""
    from handbench.groundtruth.cameras.cameras import load_pycolmap

    library, points_m = load_pycolmap(), np.random.default_rng(0).uniform(-0.2, 0.2, (22, 3))
    model = library.Reconstruction()
    model.add_camera_with_trivial_rig(
        library.Camera(
            camera_id=1,
            model="OPENCV",
            width=SIZE[0],
            height=SIZE[1],
            params=[44, 44, 20, 15, 0, 0, 0, 0],
        )
    )
    for k, name in enumerate(NAMES):
        pose = library.Rigid3d(library.Rotation3d(np.eye(3)), np.array([0.1 * k, 0, 1.0]))
        seen = [
            library.Point2D(pixel)
            for pixel in np.asarray(model.cameras[1].img_from_cam(pose * points_m))
        ]
        model.add_image_with_trivial_frame(library.Image(name, seen, 1, k + 1), pose)
    for number, point_m in enumerate(points_m):
        track = library.Track([library.TrackElement(k + 1, number) for k in range(len(NAMES))])
        model.add_point3D(point_m, track, np.zeros(3, np.uint8))
    return model


def colmap(folder: Path) -> None:
    """A COLMAP model, binary."""
    (folder / "sparse").mkdir()
    colmap_model().write_binary(folder / "sparse")


def colmap_text(folder: Path) -> None:
    """A COLMAP model as text."""
    (folder / "sparse").mkdir()
    colmap_model().write_text(folder / "sparse")


def write_obj(path: Path) -> None:
    """The tetrahedron as OBJ."""
    lines = [
        *(f"v {x} {y} {z}" for x, y, z in CORNERS_M),
        *(f"f {a}/{a} {b} {c}" for a, b, c in FACES + 1),
    ]
    path.write_text("# a tetrahedron\n" + "\n".join(lines) + "\n")


def meshes(folder: Path) -> None:
    """A tetrahedron in every form; scan.stl in millimetres."""
    from handbench.groundtruth.mesh.surface import Surface

    Surface(CORNERS_M, FACES, np.full(4, 1e-4), np.ones(4, np.uint8)).save(folder / "mesh.ply")
    write_obj(folder / "mesh.obj")
    columns = ("float x", "double y", "float z", "uchar red")
    head = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 4\n" + "".join(
        f"property {c}\n" for c in columns
    )
    rows = [*(f"{x} {y} {z} 9" for x, y, z in CORNERS_M), *(f"3 {a} {b} {c}" for a, b, c in FACES)]
    (folder / "text.ply").write_text(
        f"{head}element face 4\nproperty list uchar int vertex_index\nend_header\n"
        + "\n".join(rows)
        + "\n"
    )
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.zeros(4, facet)
    facets["corners"] = CORNERS_M[FACES]
    (folder / "mesh.stl").write_bytes(bytes(80) + np.uint32(4).tobytes() + facets.tobytes())
    corners = (
        "\n".join(f"vertex {x:.1f} {y:.1f} {z:.1f}" for x, y, z in 1e3 * CORNERS_M[face])
        for face in FACES
    )
    (folder / "scan.stl").write_text(
        "solid scan\n"
        + "\n".join(
            f"facet normal 0 0 0\nouter loop\n{three}\nendloop\nendfacet" for three in corners
        )
        + "\nendsolid scan\n"
    )


def depth(folder: Path) -> None:
    """A depth map with all that it can tell."""
    from handbench.radar.data.depthmap import DepthMap

    z_m = np.where(np.add.outer(AXIS_M, AXIS_M) > 0.02, np.nan, 0.3)
    DepthMap(
        AXIS_M,
        AXIS_M,
        z_m,
        np.where(z_m > 0, 0.0, -6.0),
        "2fsk",
        {"f1_hz": 82e9},
        z_m * 1e-3,
        z_m > 0.4,
    ).save(folder / "depth.npz")


def colmap_map(folder: Path) -> None:
    """A depth map as COLMAP's stereo writes it."""
    (folder / "depth.bin").write_bytes(b"4&3&1&" + np.arange(12, dtype="<f4").tobytes())
