"""MAROON's folders: what was written comes back, and their frame, order and sign become ours."""

import os
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.datasets.dataset import import_capture, open_capture
from handbench.bench.datasets.maroon import KEY, KEYS, MESHES, eroded, load_alignment, read_numbers
from handbench.bench.datasets.native import NativeCapture
from handbench.bench.evaluation.score import reference_of_file
from handbench.bench.stages.image import configured
from handbench.bench.stages.reconstruct import Imager
from handbench.groundtruth.mesh.surface import read_triangles
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import Axis, PixelGrid
from handbench.radar.imaging.exact import exact_images
from handbench.radar.methods.registry import method
from handbench.support.files import write_json
from tests.bench.datasets.maroon_writer import (
    AXES,
    BOX,
    FRAME,
    PLACE_M,
    TONES_HZ,
    echoes,
    plane_m,
    save_frame,
    write_maroon,
)
from tests.refusals import refuse


@pytest.fixture(scope="module")
def maroon(tmp_path_factory) -> Path:
    """Two frames as MAROON's patch/30."""
    return write_maroon(tmp_path_factory.mktemp("maroon"), echoes())


@pytest.fixture
def mine(maroon, tmp_path) -> Path:
    """A copy of the object, to spoil."""
    return shutil.copytree(maroon.parents[1], tmp_path / "maroon") / "patch" / "30"


@pytest.mark.parametrize("mirrored", [True, False])
def test_frames_box_transform_and_mesh_come_back(tmp_path, mirrored):
    """The capture and the settings of its methods, x turned there and back; `inspect` warns of a
    radar frame that is not theirs."""
    written = echoes()
    path = write_maroon(tmp_path, written, mirrored)
    maroon = open_capture(path)
    assert (maroon.about.name, maroon.about.distance_m) == ("patch-30", 0.3)
    for frames in (None, 1):
        np.testing.assert_array_equal(maroon.echoes(frames).samples, written.samples[:frames])
    axes = {axis: Axis(**AXES[axis]).values_m() for axis in "xyz"}
    for method_id, names in {"broadband": "xyz", "narrowband": "xyz", "3fsk-plus": "xy"}.items():
        settings = configured(maroon.about, method_id, {})
        for axis in names:
            np.testing.assert_allclose(getattr(settings, axis).values_m(), axes[axis], atol=1e-12)
    grid = PixelGrid(axes["x"], axes["y"])
    z_m = reference_of_file(maroon.mesh(), maroon.transform(), grid).z_m[1:-1, 1:-1]
    expected_m = np.broadcast_to(plane_m(grid.x_m[1:-1]), z_m.shape)
    np.testing.assert_allclose(z_m, expected_m, atol=1e-8)  # it is written to a nanometre
    assert len(maroon.warnings()) == (not mirrored)


def test_the_matrix_is_theirs_with_x_negated_and_its_rounding_removed(tmp_path, capsys):
    """p_radar = matrix · [p, 1], as their README has it."""
    matrix, file = np.eye(4), tmp_path / "alignment.json"
    matrix[:3, :3] = 1.7 * Rotation.random(rng=np.random.default_rng(3)).as_matrix()
    matrix[:3, 3] = 0.1, -0.2, 0.3
    for change, said in ((0.0, False), (4e-4, True)):
        theirs = np.diag([-1, 1, 1, 1]) @ (matrix + change * np.eye(4, k=1))
        write_json(file, {KEY: theirs.ravel().tolist()})
        transform = load_alignment(file)
        np.testing.assert_allclose(transform.matrix, matrix, atol=2 * change + 1e-12)
        np.testing.assert_allclose(transform.rotation @ transform.rotation.T, np.eye(3), atol=1e-12)
        assert bool(capsys.readouterr().err) == said


def test_frames_without_the_empty_room_come_on_request_alone(mine):
    path, whole = mine.with_name("30@emptyfiltered"), open_capture(mine)
    key, samples = whole.key(), whole.echoes().samples
    refuse(open_capture(path).echoes, "000000_emptyfiltered.npy")
    frame = mine / FRAME
    shutil.copy(frame.with_name("000001.npy"), frame.with_name("000000_emptyfiltered.npy"))
    assert open_capture(path).about.name == "patch-30-emptyfiltered"
    np.testing.assert_array_equal(open_capture(path).echoes().samples, samples[1:])
    assert open_capture(path).key() != whole.key() == key


def test_their_image_of_a_point_is_ours_with_x_negated(mine):
    """Echoes as their code takes them: antennas with x negated, e^{−j2πfτ} so that Σ xr·e^{+j2πfτ}
    focuses, stored as [rx, tx, f]. The point at their (x, y, z) is found at our (−x, y, z), and
    nowhere near the other candidates."""
    array, theirs_m = qar50(), PLACE_M * [-1, 1, 1]
    legs_m = [np.linalg.norm(a * [-1, 1, 1] - theirs_m, axis=1) for a in (array.rx_m, array.tx_m)]
    tau_s = np.add.outer(*legs_m) / SPEED_OF_LIGHT_M_S
    xr = np.ones((96, 96, len(TONES_HZ)), complex)  # antennas that are not used must not matter
    xr[1:95, 1:95] = np.exp(-2j * np.pi * tau_s[..., None] * TONES_HZ)
    save_frame(mine / FRAME, {"fvec": TONES_HZ, "xr": xr})
    read = open_capture(mine).echoes(1)
    others_m = theirs_m, PLACE_M * [1, -1, 1], PLACE_M[[1, 0, 2]] * [-1, -1, 1]
    places_m = np.stack([PLACE_M, *others_m])
    whole = (read.samples[0], read.frequencies_hz, read.aperture, places_m)
    images = np.abs(exact_images(*whole, per_tone=False)[0])
    assert images[0] == pytest.approx(xr[1:95, 1:95].size, rel=1e-5)
    assert images[1:].max() < 0.1 * images[0]


VOLUME = {"bb_min": [-0.1, -0.05, 0.25], "bb_max": [0.2, 0.15000000596, 0.4]}  # single precision


def test_the_box_is_theirs_rounded_or_moved_to_the_object(mine):
    write_json(mine / BOX, {"000000": {"volume": VOLUME | {"grid_size": [301, 201, 151]}}})
    y_m = configured(open_capture(mine).about, "broadband", {}).y.values_m()
    assert (y_m[0], y_m[-1], len(y_m)) == (-0.05, 0.15, 201)
    (mine / BOX).unlink()
    write_json(mine / "metadata.json", {"distance_meters": 0.5})
    about = open_capture(mine).about
    z = configured(about, "broadband", {}).z
    assert (z.start_m, z.stop_m) == (0.45, 0.6)
    assert configured(about, "3fsk", {}).x == method("3fsk").defaults.x


def test_what_their_code_puts_in_the_place_of_missing_files(mine):
    """The calibration's alignment, which stays inside its folder, and the whole mesh."""
    matrix = open_capture(mine).transform().matrix
    coarse = mine.parents[1] / "00_registration" / "01_coarse"
    coarse.mkdir(parents=True)
    (mine / "alignment.json").rename(coarse / "alignment.json")
    assert open_capture(mine).transform() is None
    write_json(mine / "metadata.json", {"calibration": "01_coarse", "calibration_fine": "fine"})
    np.testing.assert_array_equal(open_capture(mine).transform().matrix, matrix)
    write_json(mine / "metadata.json", {"calibration": "../../../secret"})
    refuse(open_capture(mine).transform, "calibration", "../../../secret")
    (mine / "photogrammetry" / MESHES[0]).unlink()
    assert open_capture(mine).mesh().name == MESHES[1]
    (mine / "photogrammetry" / MESHES[1]).unlink()
    assert open_capture(mine).mesh() is None


def test_the_mask_is_their_box_and_their_erosion(mine):
    z_m, axis_m = np.full((21, 21), 0.3), 0.001 * np.arange(-10, 11)
    z_m[0], z_m[-1], z_m[10, 10] = np.nan, 0.8, 0.2
    depth = DepthMap(axis_m, axis_m, z_m, np.zeros_like(z_m), "test")

    def mask(erode=False, **metadata):
        write_json(mine / "metadata.json", metadata)
        return open_capture(mine).mask(depth, erode=erode)

    metadata = {"distance_meters": 0.3, "mask_erosion": 20}  # zmin 0.26, zmax 0.7
    assert mask(**metadata).sum() == 19 * 21 - 1
    # Eroded by 5 × 5: rows 1 to 20 are on target, of which 3 to 20 stay (the border erodes
    # nothing); then the box takes row 20 and the near pixel.
    assert mask(erode=True, **metadata).sum() == 17 * 21 - 1
    right = mask(distance_meters=0.3, mask_bb={"xmin": 0.0045})
    assert right[:, :6].any() and not right[:, 6:].any()  # their xmin is our xmax
    refuse(lambda: mask(mask_bb={"zmin": 0.23, "zmax": 0.1}), "mask_bb", "zmin 0.23")


def test_erosion_leaves_more_than_ten_pixels():
    mask = np.zeros((20, 20), bool)
    mask[5:11, 5:11] = True
    # 5 × 5 would leave 4, 4 × 4 leaves 9: too few
    assert eroded(mask, 3).sum() == eroded(mask, 5).sum() == 16


CROOKED = np.diag([-1.0, 1.0, 1.0, 1.0]) + 4e-3 * np.eye(4, k=1)
XR = np.ones((96, 96, 6), np.complex64)
BROKEN = {
    "a crooked matrix": ("alignment.json", {KEY: CROOKED.tolist()}, KEY),
    "no voxels": (BOX, {"000000": {"volume": VOLUME | {"grid_size": [2, 2, 0]}}}, "grid_size.2"),
    "other antennas": (FRAME, {"fvec": TONES_HZ, "xr": XR[:94, :94]}, "'xr'"),
    "two sweeps": (FRAME, {"fvec": TONES_HZ + 1e6, "xr": XR}, "'fvec'"),
    "no numbers": (FRAME, {"fvec": 72e9, "xr": XR}, "000000.npy"),
}


@pytest.mark.parametrize(("file", "content", "place"), BROKEN.values(), ids=BROKEN)
def test_broken_files_are_refused(mine, tmp_path, file, content, place):
    (save_frame if file == FRAME else write_json)(mine / file, content)
    refuse(lambda: import_capture("maroon", mine, tmp_path / "out"), str(mine), place)


class Runs:
    """Runs a command when unpickled without care."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return os.system, (f"touch {self.file}",)


def test_a_pickle_may_name_numpy_s_arrays_and_nothing_else(tmp_path):
    file, ran = tmp_path / "a.npy", tmp_path / "ran"
    by_column, big_endian = np.asfortranarray(np.eye(2, 3)), np.arange(3, dtype=">c16")
    numbers = dict(zip(KEYS, (by_column, big_endian), strict=True))
    content = numbers | {"n": 3, "half": np.float32(0.5), "others": np.array(["ü"])}
    save_frame(file, content)
    header = file.read_bytes()[:128]
    older = pickle.dumps(np.array(content, object), 3).replace(b"numpy._core", b"numpy.core")
    for written in (file.read_bytes(), header + older):  # as numpy 1 wrote it
        file.write_bytes(written)
        for read, values in zip(read_numbers(file), numbers.values(), strict=True):
            np.testing.assert_array_equal(read, values)
    save_frame(file, {"xr": Runs(ran)})
    refuse(lambda: read_numbers(file), "a.npy", ".system")
    assert not ran.exists()


KERNELS = Path(__file__).with_name("maroon_kernels.npy")
BROADBAND = {"tones_hz": {"count": 5}, "threshold_db": -14.0, "subvoxel": True}
PIXELS = {axis: AXES[axis] for axis in "xy"}


@pytest.mark.parametrize(
    ("row", "id", "config"), [(0, "2fsk", PIXELS), (1, "broadband", AXES | BROADBAND)]
)
def test_depths_agree_with_those_of_their_kernels(maroon, row, id, config):
    """A micrometre in the median. The file has depths [2, y, x] of this capture, metres, by the
    arithmetic of their public code in single precision (cuda/holo_reco_sfcw_optimized.cu,
    extract_depth_parabola_fit); 2-FSK is the paper's formula on their images, without the error
    that all pixels have from their rounded 2πf."""
    [depth] = Imager(maroon, id, config | {"tolerance": None}).images().depths
    off_m = np.abs(depth.z_m - np.load(KERNELS)[row])
    assert np.isfinite(off_m).sum() > 20 and np.nanmedian(off_m) <= 1e-6


READ = ("metadata.json", "alignment.json", BOX, "photogrammetry/mesh_masked.obj", FRAME)


def test_the_key_minds_what_a_run_reads_and_nothing_else(mine):
    key = open_capture(mine).key(1)
    (mine / FRAME).with_name("000001.npy").write_bytes(b"not among the first frames")
    (mine / FRAME).with_name("depth.png").write_bytes(b"made by their tools")
    assert open_capture(mine).key(1) == key != open_capture(mine).key(2)
    for name in READ:
        kept = (mine / name).read_bytes()
        (mine / name).write_bytes(kept + b" ")
        assert open_capture(mine).key(1) != key, name
        (mine / name).write_bytes(kept)


def test_an_object_becomes_a_capture_folder(maroon, tmp_path):
    import_capture("maroon", maroon, tmp_path / "native")
    native, maroon = open_capture(tmp_path / "native"), open_capture(maroon)
    assert type(native) is NativeCapture
    contains = "echoes.h5", "mesh.ply", "radar_from_photo.json"
    assert native.about == maroon.about.model_copy(update={"contains": contains})
    np.testing.assert_array_equal(native.echoes().samples, maroon.echoes().samples)
    np.testing.assert_allclose(native.transform().matrix, maroon.transform().matrix, atol=1e-15)
    vertices_m = [read_triangles(capture.mesh())[0] for capture in (native, maroon)]
    np.testing.assert_allclose(*vertices_m, atol=1e-7)  # the mesh is written in float32
    refuse(lambda: import_capture("mapping", maroon.folder, tmp_path / "other"), "mapping")


MAE_M = {"2fsk": 1e-3, "3fsk": 3e-4, "broadband": 1.5e-3, "narrowband": 6e-3}  # measured: 83 %


def test_the_paper_s_methods_image_their_128_tones(tmp_path):
    """Their noise is a tenth of the echoes, and the projections' voxels are 2 mm deep."""
    path = write_maroon(tmp_path, echoes(1, np.linspace(72e9, 82e9, 128)))
    bench, _ = load_benchmark(str(path))
    assert [entry.id for entry in bench.method] == list(MAE_M)
    for id, bound_m in MAE_M.items():
        [depth] = Imager(path, id, {}).images().depths
        assert np.nanmean(np.abs(depth.z_m - plane_m(depth.x_m))) < bound_m, id
