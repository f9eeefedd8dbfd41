"""MAROON's folders: what was written comes back, and their frame, order and sign become ours."""

import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench.datasets.dataset import import_capture, open_capture
from handbench.bench.datasets.maroon import MESHES, eroded
from handbench.bench.datasets.maroon_alignment import KEY, load_alignment
from handbench.bench.datasets.maroon_frame import KEYS, read_numbers
from handbench.bench.datasets.native import NativeCapture
from handbench.bench.pipeline.image import configuration
from handbench.bench.pipeline.score import reference_of_file
from handbench.bench.results.result_folder import load
from handbench.bench.stages.reconstruct import Imager
from handbench.calibration.transforms import Transform, identity
from handbench.cli.main import main
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import Axis, PixelGrid
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from handbench.support.limits import PICKLE_BYTES
from tests.bench.datasets.foreign_captures import (
    AXES,
    PIXELS,
    PLACE_M,
    TONES_HZ,
    echoes,
    write_native,
)
from tests.bench.datasets.maroon_writer import write_alignment, write_frame, write_maroon
from tests.radar.exact import backproject


def frame_of(folder):
    """Its first frame."""
    return next(folder.glob("radar_*/calibrated_data/000000.npy"))


@pytest.mark.parametrize("mirrored", [True, False])
def test_frames_box_transform_and_mesh_come_back(native, tmp_path, mirrored):
    """The capture and the settings of its methods, x turned there and back; `inspect` warns of a
    radar frame that is not theirs."""
    path = write_maroon(native, tmp_path, mirrored)
    native, maroon = open_capture(native), open_capture(path)
    assert (maroon.about.name, maroon.about.distance_m) == ("patch-30", 0.3)
    for frames in (None, 1):
        np.testing.assert_array_equal(maroon.echoes(frames).samples, native.echoes(frames).samples)
    axes = {axis: Axis(**AXES[axis]).values_m() for axis in "xyz"}
    for method_id, names in {"broadband": "xyz", "narrowband": "xyz", "3fsk-plus": "xy"}.items():
        settings = configuration(path, method_id, {})
        for axis in names:
            np.testing.assert_allclose(getattr(settings, axis).values_m(), axes[axis], atol=1e-12)
    grid = PixelGrid(axes["x"], axes["y"])
    true = reference_of_file(native.truth, identity("radar"), grid)
    read = reference_of_file(maroon.mesh(), maroon.transform(), grid)
    np.testing.assert_allclose(read.z_m, true.z_m, atol=1e-8)  # it is written to a nanometre
    assert ["has no reflection" in text for text in maroon.warnings()] == [True] * (not mirrored)


def test_the_matrix_is_theirs_with_x_negated_and_its_rounding_removed(tmp_path, capsys):
    """p_radar = matrix · [p, 1], as their README has it."""
    matrix, file = np.eye(4), tmp_path / "alignment.json"
    matrix[:3, :3] = 1.7 * Rotation.random(rng=np.random.default_rng(3)).as_matrix()
    matrix[:3, 3] = 0.1, -0.2, 0.3
    for change, said in ((0.0, False), (4e-4, True)):
        theirs = np.diag([-1, 1, 1, 1]) @ (matrix + change * np.eye(4, k=1))
        file.write_text(json.dumps({KEY: theirs[:3].tolist() + [[0, 0, 0, 1]]}))
        found = load_alignment(file)
        np.testing.assert_allclose(found.matrix, matrix, atol=2 * change + 1e-12)
        np.testing.assert_allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-12)
        assert ("nearest rotation" in capsys.readouterr().err) == said


ALIGNMENTS = {
    "NaN": ((0, 0), float("nan"), "photogrammetry2radar.0' is nan"),
    "last row": ((3, 0), 0.1, "differs by .* from a rotation with one scale"),
    "crooked": ((0, 1), 4e-3, "differs by .* from a rotation with one scale"),
}


@pytest.mark.parametrize(("at", "value", "words"), ALIGNMENTS.values(), ids=ALIGNMENTS)
def test_matrices_that_are_no_similarity_in_metres_are_refused(tmp_path, at, value, words):
    matrix, file = np.diag([1.0, -1.0, 1.0, 1.0]), tmp_path / "alignment.json"
    matrix[at] = value
    file.write_text(json.dumps({KEY: matrix.tolist()}))
    with pytest.raises(HandbenchError, match=words):
        load_alignment(file)


def test_frames_without_the_empty_room_come_on_request_alone(mine):
    path, whole = mine.with_name("30@emptyfiltered"), open_capture(mine).echoes(1)
    with pytest.raises(HandbenchError, match=r"000000_emptyfiltered\.npy: expected a radar frame"):
        open_capture(path).echoes()
    before = open_capture(mine).key()
    file = frame_of(mine).with_name("000000_emptyfiltered.npy")
    write_frame(file, 0, 0.75 * whole.samples[0], TONES_HZ)
    assert open_capture(path).about.name == "patch-30-emptyfiltered"
    np.testing.assert_allclose(open_capture(path).echoes().samples, 0.75 * whole.samples, rtol=1e-6)
    assert open_capture(path).key() != open_capture(mine).key() == before


def test_their_image_of_a_point_is_ours_with_x_negated(mine):
    """Echoes as their code takes them: antennas with x negated, e^{−j2πfτ} so that Σ xr·e^{+j2πfτ}
    focuses, stored as [rx, tx, f]. The point at their (x, y, z) is found at our (−x, y, z), and
    nowhere near the other candidates."""
    array, theirs_m = qar50(), PLACE_M * [-1, 1, 1]
    legs_m = [np.linalg.norm(a * [-1, 1, 1] - theirs_m, axis=1) for a in (array.rx_m, array.tx_m)]
    tau_s = np.add.outer(*legs_m) / SPEED_OF_LIGHT_M_S
    xr = np.ones((96, 96, len(TONES_HZ)), complex)  # antennas that are not used must not matter
    xr[1:95, 1:95] = np.exp(-2j * np.pi * tau_s[..., None] * TONES_HZ)
    content = {"fvec": TONES_HZ, "xr": xr}
    np.save(frame_of(mine), np.array(content, dtype=object), allow_pickle=True)
    found = open_capture(mine).echoes(1)
    others_m = theirs_m, PLACE_M * [1, -1, 1], PLACE_M[[1, 0, 2]] * [-1, -1, 1]
    places_m = np.stack([PLACE_M, *others_m])
    images = np.abs(backproject(found.samples[0], found.frequencies_hz, found.aperture, places_m))
    assert images[0] == pytest.approx(xr[1:95, 1:95].size, rel=1e-5)
    assert images[1:].max() < 0.1 * images[0]


def test_a_box_in_single_precision_is_rounded_and_an_empty_one_is_refused(mine):
    file = next(mine.glob("radar_*/calibration.json"))
    volume = {"bb_min": [-0.1, -0.05, 0.25], "bb_max": [0.2, 0.15000000596, 0.4]}
    file.write_text(json.dumps({"000000": {"volume": volume | {"grid_size": [301, 201, 151]}}}))
    y_m = configuration(mine, "broadband", {}).y.values_m()
    assert (y_m[0], y_m[-1], len(y_m)) == (-0.05, 0.15, 201)
    file.write_text(json.dumps({"000000": {"volume": volume | {"grid_size": [2, 2, 0]}}}))
    with pytest.raises(HandbenchError, match=r"volume\.grid_size\.2' is 0"):
        configuration(mine, "3fsk", {})


def test_without_a_box_their_shipped_one_is_moved_to_the_object(mine):
    next(mine.glob("radar_*")).joinpath("calibration.json").unlink()
    (mine / "metadata.json").write_text('{"distance_meters": 0.5}')
    z = configuration(mine, "broadband", {}).z
    assert (z.start_m, z.stop_m) == (0.45, 0.6)
    assert configuration(mine, "3fsk", {}).x == method("3fsk").defaults.x


def test_the_alignment_of_the_calibration_stands_in(mine):
    matrix, metadata = np.diag([1.0, -1.0, -1.0, 1.0]), mine / "metadata.json"
    matrix[:3, 3] = 0.01, 0.02, 0.3
    (mine / "alignment.json").unlink()
    assert open_capture(mine).transform() is None
    coarse = mine.parents[1] / "00_registration" / "01_coarse"
    coarse.mkdir(parents=True)
    metadata.write_text('{"calibration": "01_coarse", "calibration_fine": "01_fine"}')
    write_alignment(coarse / "alignment.json", Transform("photo", "radar", matrix))
    np.testing.assert_allclose(open_capture(mine).transform().matrix, matrix, atol=1e-12)
    metadata.write_text('{"calibration": "../../../secret"}')
    with pytest.raises(HandbenchError, match="is outside the folder"):
        open_capture(mine).transform()


def test_the_whole_mesh_stands_in_for_a_masked_one_and_no_other_does(mine, capsys):
    (mine / "photogrammetry" / MESHES[0]).unlink()
    assert open_capture(mine).mesh().name == "mesh.obj"
    assert "has no mesh_masked.obj, so mesh.obj is used" in capsys.readouterr().err
    (mine / "photogrammetry" / MESHES[1]).unlink()
    assert open_capture(mine).mesh() is None


def test_the_mask_is_their_box_and_their_erosion(mine):
    z_m, axis_m, metadata = np.full((21, 21), 0.3), 0.001 * np.arange(-10, 11), {}
    z_m[0], z_m[-1], z_m[10, 10] = np.nan, 0.8, 0.2
    depth = DepthMap(axis_m, axis_m, z_m, np.zeros_like(z_m), "test")

    def mask(erode=False, **metadata):
        (mine / "metadata.json").write_text(json.dumps(metadata))
        return open_capture(mine).mask(depth, erode=erode)

    metadata = {"distance_meters": 0.3, "mask_erosion": 20}  # zmin 0.26, zmax 0.7
    assert mask(**metadata).sum() == 19 * 21 - 1
    # Eroded by 5 × 5: rows 1 to 20 are on target, of which 3 to 20 stay (the border erodes
    # nothing); then the box takes row 20 and the near pixel.
    assert mask(erode=True, **metadata).sum() == 17 * 21 - 1
    found = mask(distance_meters=0.3, mask_bb={"xmin": 0.0045})
    assert found[:, :6].any() and not found[:, 6:].any()  # their xmin is our xmax
    with pytest.raises(HandbenchError, match=r"zmax 0\.1 below zmin 0\.23"):
        mask(mask_bb={"zmin": 0.23, "zmax": 0.1})


FRAMES = {
    "other antennas": (
        {"xr": np.zeros((94, 94, 6), np.complex64)},
        r"'xr' is \(94, 94, 6\); expected \(96, 96, 6\)",
    ),
    "two sweeps": (
        {"fvec": TONES_HZ + 1e6},
        "calibrated_data: the frequencies 'fvec' of its frames",
    ),
    "an object": ({"fvec": 72e9}, "000000.npy: was not read"),
}


@pytest.mark.parametrize(("change", "reason"), FRAMES.values(), ids=FRAMES)
def test_frames_that_are_not_the_radar_s_are_refused(mine, change, reason):
    ones = np.ones((96, 96, 6), np.complex64)
    content = {"fvec": TONES_HZ, "xr": ones} | change
    np.save(frame_of(mine), np.array(content, dtype=object), allow_pickle=True)
    with pytest.raises(HandbenchError, match=reason) as caught:
        open_capture(mine).echoes()
    assert "\n" not in str(caught.value)


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
    held = np.array(
        numbers | {"n": 3, "half": np.float32(0.5), "text": "ü", "others": np.array(["ü"])},
        dtype=object,
    )
    np.save(file, held, allow_pickle=True)
    written = file.read_bytes()
    older = pickle.dumps(held, 3).replace(b"numpy._core", b"numpy.core")  # as numpy 1 wrote it
    for content in (written, written[:128] + older):
        file.write_bytes(content)
        for read, values in zip(read_numbers(file), numbers.values(), strict=True):
            np.testing.assert_array_equal(read, values)
    with file.open("wb") as stream:
        stream.truncate(PICKLE_BYTES + 1)
    with pytest.raises(HandbenchError, match="at most 268435456"):
        read_numbers(file)
    for spoiled in (Runs(ran), np.array([Runs(ran)], object)):
        np.save(file, np.array({"xr": spoiled}, object), allow_pickle=True)
        with pytest.raises(HandbenchError, match=r"it uses (posix|nt)\.system"):
            read_numbers(file)
    assert not ran.exists()
    np.load(file, allow_pickle=True)
    assert ran.exists()  # the test can fail


KERNELS = Path(__file__).with_name("maroon_kernels.npy")
BROADBAND = {"tones_hz": {"count": 5}, "threshold_db": -14.0, "subvoxel": True}


@pytest.mark.parametrize(
    ("row", "id", "config"), [(0, "2fsk", PIXELS), (1, "broadband", AXES | BROADBAND)]
)
def test_depths_agree_with_those_of_their_kernels(maroon, row, id, config):
    """A micrometre in the median. The file has depths [2, y, x] of this capture, metres, by the
    arithmetic of their public code in single precision (cuda/holo_reco_sfcw_optimized.cu,
    extract_depth_parabola_fit); 2-FSK is the paper's formula on their images, without the error
    that all pixels have from their rounded 2πf."""
    [found] = Imager(maroon, id, config | {"tolerance": None}).images().depths
    off_m = np.abs(found.z_m - np.load(KERNELS)[row])
    assert np.isfinite(off_m).sum() > 20 and np.nanmedian(off_m) <= 1e-6


READ = (
    *("metadata.json", "alignment.json", "radar_*/calibration.json"),
    *("photogrammetry/mesh_masked.obj", "radar_*/calibrated_data/000000.npy"),
)


def test_the_key_minds_what_a_run_reads_and_nothing_else(mine):
    before = open_capture(mine).key(1)
    frame_of(mine).with_name("000001.npy").write_bytes(b"not among the first frames")
    (frame_of(mine).parents[1] / "depth.png").write_bytes(b"made by their tools")
    assert open_capture(mine).key(1) == before != open_capture(mine).key(2)
    for name in READ:
        [file] = mine.glob(name)
        kept = file.read_bytes()
        file.write_bytes(kept + b" ")
        assert open_capture(mine).key(1) != before, file
        file.write_bytes(kept)
    assert open_capture(mine).key(1) == before


def test_erosion_leaves_more_than_ten_pixels():
    mask = np.zeros((20, 20), bool)
    mask[5:11, 5:11] = True
    # 5 × 5 would leave 4, 4 × 4 leaves 9: too few
    assert eroded(mask, 3).sum() == eroded(mask, 5).sum() == 16


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
    with pytest.raises(HandbenchError, match="is not a capture of 'mapping' but of MaroonCapture"):
        import_capture("mapping", maroon.folder, tmp_path / "other")


def test_from_the_folder_to_the_table_in_one_command(tmp_path, monkeypatch):
    """The paper's four methods, with MAROON's 128 tones."""
    monkeypatch.setattr("handbench.bench.stages.reconstruct.REPEATED_S", 0.0)
    native = write_native(tmp_path / "native", echoes(1, np.linspace(72e9, 82e9, 128)))
    write_maroon(native, tmp_path / "maroon")
    assert main(["run", str(tmp_path / "maroon"), "-o", str(tmp_path / "out")]) == 0
    table = load(tmp_path / "out").table.query("metric == 'mae_mm'").set_index("method")
    assert table.value["3fsk"] < 0.5 and table.value["broadband"] < 1.5 and table.value["2fsk"] < 5
