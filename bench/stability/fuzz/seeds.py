"""Small valid inputs of every reader, each written into an empty folder, by the writers of the product where it has
them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomlkit

if TYPE_CHECKING:
    import pycolmap
    from PIL import Image

    from calibration.transforms import Transform
    from groundtruth.photos import Photo
    from radar.capture import RadarCapture

POINTS_M = np.array([[0.01, -0.02, 0.30], [-0.03, 0.0, 0.29], [0.0, 0.04, 0.31]])
CORNERS_M = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
NAMES, SIZE = ("a.jpg", "b.png", "d.png"), (40, 30)  # photographs, of this width and height
AXIS_M = np.linspace(-0.02, 0.02, 5)
MAROON = ("hand", "30", "radar_72.0_82.0_2")


def _echoes(tones: int = 3) -> RadarCapture:
    from radar.arrays import AntennaArray
    from radar.capture import RadarCapture

    rng = np.random.default_rng(4)
    samples = rng.standard_normal((1, tones, 2, 3, 2)) @ [1, 1j]
    array = AntennaArray(rng.uniform(-0.1, 0.1, (2, 3)), rng.uniform(-0.1, 0.1, (3, 3)))
    return RadarCapture(samples.astype(np.complex64), np.linspace(72e9, 82e9, tones), array)


def capture(folder: Path) -> None:
    """A capture folder with the calibration of its array."""
    from bench.datasets.native import ARRAY, ECHOES, CaptureFile, save_capture_file
    from radar.capture import save_capture

    echoes = _echoes()
    save_capture(folder / ECHOES, echoes)
    _save_array(folder / ARRAY, echoes.aperture.tx_m, echoes.aperture.rx_m)
    about = CaptureFile(name="hand", pose="F", distance_m=0.3, box_m=(-1, -1, -1, 1, 1, 1), contains=(ECHOES,),
                        methods={"3fsk": {"x": {"start_m": -0.1, "stop_m": 0.1, "step_m": 0.001}}})
    save_capture_file(folder, about)


def _save_array(path: Path, tx_m: np.ndarray, rx_m: np.ndarray) -> None:
    from calibration.array.file import ArrayCalibration, Side, save_array

    def side(places_m: np.ndarray) -> Side:
        n = len(places_m)
        return Side(
            nominal_m=places_m.tolist(), gain=[(1.0, 0.1)] * n, delay_m=[1e-4] * n, offset_m=[(1e-5, 0, 0)] * n,
            level_sigma=[0.01] * n, phase_sigma_rad=[0.01] * n, delay_sigma_m=[1e-5] * n, offset_sigma_m=[(1e-5,) * 3] * n,
        )

    save_array(path, ArrayCalibration(
        source="target", reference_hz=77e9, tx=side(tx_m), rx=side(rx_m), residual_before_db=-10, residual_after_db=-30
    ))


def array(folder: Path) -> None:
    """The calibration of an array."""
    _save_array(folder / "array.json", POINTS_M, POINTS_M[:2])


def antennas(folder: Path) -> None:
    """An array's positions."""
    rows = "\n".join(",".join(map(repr, row)) for row in POINTS_M.tolist())
    (folder / "array.csv").write_text(f"x_m,y_m,z_m\n{rows}\n")


def scan(folder: Path) -> None:
    """A planar scan as a capture folder; its samples packed in chunks."""
    import h5py

    from bench.datasets.native import ECHOES, CaptureFile, save_capture_file
    from radar.arrays import PlanarScan
    from radar.capture import RadarCapture, save_capture

    samples = np.ones((2, 3, 4), np.complex64)
    save_capture(folder / ECHOES, RadarCapture(samples, np.linspace(22e9, 26e9, 3), PlanarScan(np.eye(4)[:, :3])))
    with h5py.File(folder / ECHOES, "r+") as file:
        del file["samples"]
        file.create_dataset("samples", data=samples, chunks=(1, 2, 4), compression="gzip", shuffle=True)
    save_capture_file(folder, CaptureFile(name="scan", kind="scan", contains=(ECHOES,)))


def mapping(folder: Path) -> None:
    """An HDF5 file as MATLAB writes it, and its description."""
    import h5py

    echoes = _echoes()
    with h5py.File(folder / "hand.mat", "w") as file:
        file["xr"] = np.ascontiguousarray(echoes.samples.conj()).view([("real", "<f4"), ("imag", "<f4")])
        file["set/f"] = echoes.frequencies_hz[:, None] / 1e9
        file["set/tx"], file["set/rx"] = 1e3 * echoes.aperture.tx_m.T, 1e3 * echoes.aperture.rx_m.T
    positions = {"unit": "mm", "reversed": True, "x": "right"}
    (folder / "mapping.toml").write_text(tomlkit.dumps({
        "version": 1, "file": "hand.mat", "capture": {"name": "hand", "distance_m": 0.3},
        "samples": {"dataset": "xr", "axes": ["rx", "tx", "frequency", "frame"], "reversed": True, "sign": "+"},
        "frequencies": {"dataset": "set/f", "unit": "GHz"},
        "tx": {"dataset": "set/tx", **positions}, "rx": {"dataset": "set/rx", **positions},
    }))


def maroon(folder: Path) -> None:
    """One object at one distance of MAROON."""
    from bench.datasets.maroon_frame import Frame, write_frame
    from calibration.alignment import save_alignment
    from radar.files import write_json

    at = folder.joinpath(*MAROON)
    write_frame(at / "calibrated_data" / "000000.npy", 0, Frame(np.ones((2, 94, 94)), np.array([72e9, 82e9]), 1))
    volume = {"bb_min": [-0.1, -0.1, 0.25], "bb_max": [0.1, 0.1, 0.4], "grid_size": [21, 21, 16]}
    write_json(at / "calibration.json", {"000000": {"volume": volume}})
    write_json(at.parent / "metadata.json", {
        "distance_meters": 0.3, "mask_erosion": 8, "mask_bb": {"zmin": 0.2, "zmax": 0.5}, "labels": ["hand"],
    })
    save_alignment(at.parent / "alignment.json", _radar_from_photo())
    (at.parent / "photogrammetry").mkdir()
    _write_obj(at.parent / "photogrammetry" / "mesh_masked.obj")
    depth(folder)


def planar_scan(folder: Path) -> None:
    """The six arrays of a raster scan, and its phases."""
    rng = np.random.default_rng(2)
    with (folder / "scan.npy").open("wb") as stream:
        for values in (rng.integers(0, 2**16, (2, 3, 4, 5)).astype(np.uint16), 22.2e9, 26.2e9, 3, [2e-3, 2e-3], 0.1):
            np.save(stream, np.array(values))
    np.savetxt(folder / "phase.txt", [[22.2e9, 24e9, 26.2e9], [0.1, 0.2, -0.3]])


def scene(folder: Path) -> None:
    """A hand on its stand, with every table of a scene file."""
    (folder / "scene.toml").write_text("""
version = 1
name = "F"
seed = 70
effects = "auto"
tolerance_mm = 0.1
[target]
kind = "hand"
pose = "F"
material = { kind = "skin" }
distance_m = 0.31
offset_m = [0.0, -0.03]
rotation_deg = [1.0, 2.0, 3.0]
[sensor]
array = "qar50"
sweep = [{ start_hz = 72e9, stop_hz = 82e9, count = 16 }]
tones_hz = [81.8e9, 79.5e9]
[noise]
[stand]
empty = true
[photos]
cameras = 8
width = 600
[mount]
offset_m = [0.004, -0.006, 0.4]
""")


def benchmark(folder: Path) -> None:
    """A benchmark of one scene by two methods."""
    scene(folder)
    axis = "{ start_m = -0.02, stop_m = 0.02, step_m = 0.002 }"
    (folder / "bench.toml").write_text(f"""
version = 1
name = "small"
seed = 1
repeats = 3
phase_noise_rad = 0.03
[groundtruth]
quality = "draft"
[[capture]]
scene = "scene.toml"
[[method]]
id = "2fsk"
precision = true
config = {{ x = {axis}, y = {axis} }}
[[method]]
id = "narrowband"
every_nth_antenna = 2
config = {{ x = {axis}, y = {axis}, z = {{ start_m = 0.27, stop_m = 0.29, step_m = 0.002 }} }}
[tradeoff]
repeats = 3
reference = "2fsk-tolerance-1e-2"
[[tradeoff.imaging]]
method = "2fsk"
sweep = {{ tolerance = [1e-2, 1e-3] }}
""")


def target(folder: Path) -> None:
    """The calibration target."""
    from calibration.target import default_target, save_target

    save_target(folder / "target.toml", default_target())


def board(folder: Path) -> None:
    """Markers and a ChArUco board."""
    from groundtruth.board import Board, save_board

    corners_m = [(0, 0, 0), (0.02, 0, 0), (0.02, -0.02, 0), (0, -0.02, 0)]
    save_board(folder / "board.toml", Board(
        dictionary="DICT_5X5_50", marker=[{"id": 3, "corners_m": corners_m}],
        charuco={"columns": 5, "rows": 4, "square_m": 0.03, "marker_m": 0.02},
    ))


def _radar_from_photo() -> Transform:
    from scipy.spatial.transform import Rotation

    from calibration.transforms import Transform

    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), (0.1, 0.2, 0.5)
    return Transform("photo", "radar", matrix, np.diag([1e-8] * 6), np.array([1e-4, 2e-4]))


def transform(folder: Path) -> None:
    """radar_from_photo with its covariance."""
    _radar_from_photo().save(folder / "radar_from_photo.json")


def alignment(folder: Path) -> None:
    """The same as MAROON writes it."""
    from calibration.alignment import save_alignment

    save_alignment(folder / "alignment.json", _radar_from_photo())


def photos(folder: Path) -> tuple[Photo, ...]:
    """Photographs that need not be there, of which the last is held upright."""
    from groundtruth.photos import Photo

    return tuple(Photo(folder / name, name, *SIZE, orientation=6 if name == "d.png" else 1) for name in NAMES)


def cameras(folder: Path) -> None:
    """cameras.json: the last camera is of the upright picture, and turned back."""
    from groundtruth.cameras import Camera, save_cameras

    sizes = (SIZE, SIZE, SIZE[::-1])
    save_cameras(folder / "cameras.json", tuple(
        Camera(name=name, width=w, height=h, params=(44.0, 44.1, w / 2, h / 2, -0.05, 0.01, 1e-3, 1e-3),
               R=np.eye(3).tolist(), t=(0.1 * k, 0.0, 0.5))
        for k, (name, (w, h)) in enumerate(zip(NAMES, sizes, strict=True))
    ))


def metashape(folder: Path) -> None:
    """Metashape's export of three cameras."""
    def words(values: np.ndarray) -> str:
        return " ".join(repr(float(value)) for value in np.ravel(values))

    views = "".join(
        f'<camera id="{k}" sensor_id="0" component_id="0" label="{Path(name).stem}"><transform>{words(np.eye(4))}'
        "</transform><orientation>1</orientation></camera>" for k, name in enumerate(NAMES)
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


def _model() -> pycolmap.Reconstruction:
    from groundtruth.cameras import load_pycolmap

    library, points_m = load_pycolmap(), np.random.default_rng(0).uniform(-0.2, 0.2, (22, 3))
    model = library.Reconstruction()
    model.add_camera_with_trivial_rig(
        library.Camera(camera_id=1, model="OPENCV", width=SIZE[0], height=SIZE[1], params=[44, 44, 20, 15, 0, 0, 0, 0])
    )
    for k, name in enumerate(NAMES):
        pose = library.Rigid3d(library.Rotation3d(np.eye(3)), np.array([0.1 * k, 0, 1.0]))
        seen = [library.Point2D(pixel) for pixel in np.asarray(model.cameras[1].img_from_cam(pose * points_m))]
        model.add_image_with_trivial_frame(library.Image(name, seen, 1, k + 1), pose)
    for number, point_m in enumerate(points_m):
        track = library.Track([library.TrackElement(k + 1, number) for k in range(len(NAMES))])
        model.add_point3D(point_m, track, np.zeros(3, np.uint8))
    return model


def colmap(folder: Path) -> None:
    """A COLMAP model, binary."""
    (folder / "sparse").mkdir()
    _model().write_binary(folder / "sparse")


def colmap_text(folder: Path) -> None:
    """A COLMAP model as text."""
    (folder / "sparse").mkdir()
    _model().write_text(folder / "sparse")


def _write_obj(path: Path) -> None:
    lines = [*(f"v {x} {y} {z}" for x, y, z in CORNERS_M), *(f"f {a}/{a} {b} {c}" for a, b, c in FACES + 1)]
    path.write_text("# a tetrahedron\n" + "\n".join(lines) + "\n")


def meshes(folder: Path) -> None:
    """A tetrahedron in every form; scan.stl in millimetres."""
    from groundtruth.surface import Surface

    Surface(CORNERS_M, FACES, np.full(4, 1e-4), np.ones(4, np.uint8)).save(folder / "mesh.ply")
    _write_obj(folder / "mesh.obj")
    columns = ("float x", "double y", "float z", "uchar red")
    head = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 4\n" + "".join(f"property {c}\n" for c in columns)
    rows = [*(f"{x} {y} {z} 9" for x, y, z in CORNERS_M), *(f"3 {a} {b} {c}" for a, b, c in FACES)]
    (folder / "text.ply").write_text(
        f"{head}element face 4\nproperty list uchar int vertex_index\nend_header\n" + "\n".join(rows) + "\n"
    )
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.zeros(4, facet)
    facets["corners"] = CORNERS_M[FACES]
    (folder / "mesh.stl").write_bytes(bytes(80) + np.uint32(4).tobytes() + facets.tobytes())
    corners = ("\n".join(f"vertex {x:.1f} {y:.1f} {z:.1f}" for x, y, z in 1e3 * CORNERS_M[face]) for face in FACES)
    (folder / "scan.stl").write_text("solid scan\n" + "\n".join(
        f"facet normal 0 0 0\nouter loop\n{three}\nendloop\nendfacet" for three in corners
    ) + "\nendsolid scan\n")


def depth(folder: Path) -> None:
    """A depth map with all that it can tell."""
    from radar.depthmap import DepthMap

    z_m = np.where(np.add.outer(AXIS_M, AXIS_M) > 0.02, np.nan, 0.3)
    DepthMap(AXIS_M, AXIS_M, z_m, np.where(z_m > 0, 0.0, -6.0), "2fsk", {"f1_hz": 82e9}, z_m * 1e-3, z_m > 0.4).save(
        folder / "depth.npz"
    )


def _picture(mode: str = "RGB") -> Image.Image:
    from PIL import Image

    return Image.fromarray(np.random.default_rng(1).integers(0, 255, (SIZE[1], SIZE[0], 3), np.uint8)).convert(mode)


def _exif() -> Image.Exif:
    from PIL import Image

    exif = Image.Exif()
    exif[0x0110], exif[0x0112] = "Camera", 6
    exif.get_ifd(0x8769).update({0x920A: 35.0, 0xA405: 50, 0xA20E: 1000.0, 0xA210: 2, 0xA002: SIZE[0]})
    return exif


def pictures(folder: Path) -> None:
    """Photographs in every form, the first with EXIF data."""
    from PIL import Image

    _picture().save(folder / "a.jpg", exif=_exif(), quality=60)
    _picture().save(folder / "b.png")
    Image.fromarray(np.arange(1200, dtype=np.uint16).reshape(30, 40)).save(folder / "c.tif")
    _picture("P").save(folder / "d.png")


def masks(folder: Path) -> None:
    """A mask for each of `photos`, the last of the upright picture."""
    (folder / "masks").mkdir()
    for name in ("a.jpg.png", "b.png", "d.png"):
        picture = _picture("L")
        (picture.rotate(90, expand=True) if name == "d.png" else picture).save(folder / "masks" / name)


def small_photo(folder: Path) -> None:
    """A photograph to make small."""
    _picture().save(folder / "hand.jpg", exif=_exif(), quality=60)


def result(folder: Path) -> None:
    """A complete result of one method on one capture."""
    from bench import results
    from bench.comparison import Comparison
    from radar.depthmap import DepthMap

    z_m, flat = np.full((5, 5), 0.3), np.zeros((5, 5))
    DepthMap(AXIS_M, AXIS_M, z_m, flat, "2fsk").save(results.depth_path(folder, "F", "2fsk"))
    results.write_surface(folder, "F", "truth", results.Surface(AXIS_M, AXIS_M, z_m, flat))
    results.write_errors(folder, "F", "2fsk", "truth", results.ErrorMap(AXIS_M, AXIS_M, flat, z_m))
    small_photo(folder)
    results.write_photo(folder, "F", folder / "hand.jpg")
    results.write_table(folder, [results.Row("mae_mm", "2fsk", 6.0, 5.5, 6.5, "mm", 6.6, "truth")])
    task = results.Task("a", "F", "2fsk", "reconstruct", 0.1, 0.2, 300.0, False, 0.01, "here", 9.0)
    results.write_tasks(folder, [task])
    results.write_repeats(folder, [results.Repeat("F", "2fsk", 0, 0.3)])
    results.write_comparisons(folder, [
        Comparison("mae_mm", "2fsk", "3fsk", 1.0, 0.5, 1.5, "mm", 0.01, 2.0, "truth", 1, 20, "2-FSK is better")
    ])
    results.write_config(folder, 'name = "small"\n')
    results.write_about(folder, results.About(
        name="small", protocol={"id": "paper", "repeats": 3},
        metrics={"mae_mm": results.MetricFacts(title="MAE", unit="mm", better="lower", definition="mean")},
        inputs={"F": "0" * 64}, versions={"numpy": "2"}, machine={"cores": 2},
        captures=(results.CaptureFacts(name="F", pose="F", distance_m=0.3, references=("truth",)),),
        methods=(results.MethodFacts(name="2fsk", title="2-FSK", config={"F": {"tolerance": 1e-5}}),),
    ))


def tradeoff(folder: Path) -> None:
    """A trade-off of one setting."""
    from bench import results

    section = results.Section(
        name="imaging", title="Imaging", metric="mae_mm", unit="mm", definition="mean", seconds="all", reference="one"
    )
    facts = results.TradeoffFacts(name="small", scored_against="truth", sections=(section,), captures=("F",),
                                  claims=(results.Claim(text="faster", paper=1000.0),))
    figures = dict.fromkeys(("error", "low", "high", "seconds", "seconds_low", "seconds_high", "ratio", "acquisition_s",
                             "plan_s", "imaging_s", "extraction_s", "operations", "peak_memory_mb"), 1.5)
    results.write_tradeoff(folder, facts, [results.Setting(
        section="imaging", name="one", title="One", knobs=json.dumps({"tolerance": 1e-3}), metric="mae_mm", unit="mm",
        on_front=True, dominated_by="", **figures,
    )])


def stability(folder: Path) -> None:
    """A stability run of one case."""
    from bench.results.stability import HardCase, StabilityFacts, Table, write_stability

    row = HardCase("wrap", "phase", "depth", "closed form", "mm", 1.0, 0.5, "holds", "0.3 m", "rounding", 0.1)
    table = Table(title="Errors", text="small", columns=("a", "b"), rows=(("x", 1.5), ("y", None)))
    write_stability(folder, StabilityFacts(seed=0, seconds=1.0, tables=(table,)), [row])


def colmap_map(folder: Path) -> None:
    """A depth map as COLMAP's stereo writes it."""
    (folder / "depth.bin").write_bytes(b"4&3&1&" + np.arange(12, dtype="<f4").tobytes())


def stage(folder: Path) -> None:
    """What the kept stage makes."""
    depth(folder)


def kept(folder: Path) -> None:
    """A kept stage, and what it made once more beside it."""
    from bench.cache import kept_stage

    kept_stage(folder / "stage", "stage", stage)
    (folder / "fresh.npz").write_bytes((folder / "stage" / "depth.npz").read_bytes())
