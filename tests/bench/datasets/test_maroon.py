"""MAROON as it lies on disk: what was written comes back, and their frame, order and sign become
ours."""

import json
import shutil

import numpy as np
import pytest

from handbench.bench.datasets.dataset import captures, import_capture, open_capture
from handbench.bench.datasets.maroon import MESHES, MaroonCapture, eroded
from handbench.bench.datasets.maroon_alignment import save_alignment
from handbench.bench.datasets.native import NativeCapture
from handbench.bench.pipeline.image import configuration
from handbench.bench.pipeline.score import reference_of_file
from handbench.bench.run.reconstruct_stage import Imager
from handbench.calibration.transforms import Transform, identity
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.data.grid import Axis, PixelGrid
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from tests.bench.datasets.foreign_captures import (
    AXES,
    METHODS,
    PLACE_M,
    TONES_HZ,
    echoes,
    write_native,
)
from tests.bench.datasets.maroon_writer import write_maroon
from tests.radar.exact import backproject


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A capture folder with an empty room, and what it became in MAROON's layout."""
    folder = tmp_path_factory.mktemp("set")
    native = write_native(folder / "native", echoes())
    room = echoes()
    save_capture(
        native / "empty.h5", RadarCapture(0.25 * room.samples, room.frequencies_hz, room.aperture)
    )
    return native, write_maroon(native, folder / "maroon")


@pytest.fixture
def mine(written, tmp_path):
    """A copy of the object, to spoil."""
    return shutil.copytree(written[1].parents[1], tmp_path / "maroon") / "patch" / "30"


@pytest.mark.parametrize("method_id", METHODS)
def test_a_written_data_set_gives_the_same_depth_maps(written, method_id):
    """The bar is 1e-6; nothing is rounded on the way, so that the maps are the same to the last
    bit."""
    maps = []
    for capture in written:
        [found] = Imager(capture, method_id, METHODS[method_id]).images().results
        maps.append(found.depth)
    assert np.isfinite(maps[0].z_m).any()
    np.testing.assert_array_equal(maps[0].z_m, maps[1].z_m)
    np.testing.assert_array_equal(maps[0].amplitude_db, maps[1].amplitude_db)
    assert abs(np.nanmedian(maps[1].z_m) - PLACE_M[2]) < 0.005


def test_every_method_images_the_box_of_the_data_set(written):
    """calibration.json's box is what the capture's own settings were, x turned there and back."""
    for method_id in ("broadband", "narrowband", "broadband-subvoxel"):
        settings = configuration(written[1], method_id, {})
        for axis in "xyz":
            np.testing.assert_allclose(
                getattr(settings, axis).values_m(), Axis(**AXES[axis]).values_m(), atol=1e-12
            )
    for method_id in ("2fsk", "3fsk", "3fsk-plus", "nfsk"):
        assert configuration(written[1], method_id, {}).x.start_m == pytest.approx(
            AXES["x"]["start_m"], abs=1e-12
        )


def test_frames_transform_and_mesh_come_back(written):
    native, maroon = map(open_capture, written)
    assert isinstance(maroon, MaroonCapture)
    assert (maroon.about.name, maroon.about.distance_m) == ("patch-30", 0.3)
    np.testing.assert_array_equal(maroon.echoes().samples, native.echoes().samples)
    np.testing.assert_array_equal(maroon.echoes(1).samples, native.echoes(1).samples)
    grid = PixelGrid(Axis(**AXES["x"]).values_m(), Axis(**AXES["y"]).values_m())
    true = reference_of_file(native.truth, identity("radar"), grid)
    for file in (maroon.mesh(), maroon.mesh().with_name(MESHES["whole"])):
        read = reference_of_file(file, maroon.transform(), grid)
        np.testing.assert_allclose(
            read.z_m, true.z_m, atol=1e-8
        )  # the mesh is written to a nanometre


def test_frames_without_the_empty_room_come_on_request_alone(written, mine):
    path = written[1].with_name("30@emptyfiltered")
    assert open_capture(path).about.name == "patch-30-emptyfiltered"
    whole, filtered = open_capture(written[1]).echoes().samples, open_capture(path).echoes().samples
    np.testing.assert_allclose(filtered, 0.75 * whole, rtol=1e-6)
    assert open_capture(path).key() != open_capture(written[1]).key()
    for file in mine.glob("radar_*/calibrated_data/*_emptyfiltered.npy"):
        file.unlink()
    with pytest.raises(HandbenchError, match=r"000000_emptyfiltered\.npy: expected a radar frame"):
        open_capture(mine.with_name("30@emptyfiltered")).echoes()


def test_their_image_of_a_point_is_ours_with_x_negated(mine):
    """Echoes as their code takes them: antennas with x negated, e^{−j2πfτ} so that Σ xr·e^{+j2πfτ}
    focuses, stored as [rx, tx, f]. The point at their (x, y, z) is found at our (−x, y, z), and
    nowhere near the other candidates."""
    array, theirs_m = qar50(), PLACE_M * [-1, 1, 1]
    legs_m = [np.linalg.norm(a * [-1, 1, 1] - theirs_m, axis=1) for a in (array.rx_m, array.tx_m)]
    tau_s = np.add.outer(*legs_m) / SPEED_OF_LIGHT_M_S
    xr = np.ones(
        (96, 96, len(TONES_HZ)), np.complex128
    )  # the antennas that are not used must not matter
    xr[1:95, 1:95] = np.exp(-2j * np.pi * tau_s[..., None] * TONES_HZ)
    file = next(mine.glob("radar_*/calibrated_data/000000.npy"))
    content = {
        "fvec": TONES_HZ,
        "xr": xr,
        "number_of_measurements": np.array([1]),
        "timestamp_us": np.array([5]),
    }
    np.save(file, np.array(content, dtype=object), allow_pickle=True)
    (mine / "metadata.json").write_text("{}")  # no scale of ours
    capture = open_capture(mine).echoes()
    images = np.abs(
        backproject(
            capture.samples[0],
            capture.frequencies_hz,
            capture.aperture,
            np.stack([PLACE_M, theirs_m, PLACE_M * [1, -1, 1], PLACE_M[[1, 0, 2]] * [-1, -1, 1]]),
        )
    )
    assert images[0] == pytest.approx(xr[1:95, 1:95].size, rel=1e-5)
    assert images[1:].max() < 0.1 * images[0]


def test_a_boundary_of_their_x_becomes_the_other_one_of_ours(mine):
    volume = {
        "bb_min": [-0.1, -0.05, 0.25],
        "bb_max": [0.2, 0.15000000596, 0.4],
        "grid_size": [301, 201, 151],
    }
    next(mine.glob("radar_*")).joinpath("calibration.json").write_text(
        json.dumps({"000000": {"volume": volume}})
    )
    settings = configuration(mine, "broadband", {})
    ends = [(a[0], a[-1], len(a)) for a in (getattr(settings, axis).values_m() for axis in "xyz")]
    assert ends == [(-0.2, 0.1, 301), (-0.05, 0.15, 201), (0.25, 0.4, 151)]


def test_without_a_box_their_shipped_one_is_moved_to_the_object(mine):
    next(mine.glob("radar_*")).joinpath("calibration.json").unlink()
    (mine / "metadata.json").write_text('{"distance_meters": 0.5}')
    z = configuration(mine, "broadband", {}).z
    assert (z.start_m, z.stop_m) == (0.45, 0.6)
    assert configuration(mine, "3fsk", {}).x == method("3fsk").config().x


def test_the_alignment_of_the_calibration_stands_in(mine):
    matrix = np.eye(4)
    matrix[:3, 3] = 0.01, 0.02, 0.3
    (mine / "alignment.json").unlink()
    assert open_capture(mine).transform() is None
    registrations = mine.parents[1] / "00_registration"
    (mine / "metadata.json").write_text(
        '{"calibration": "01_coarse", "calibration_fine": "01_fine"}'
    )
    (registrations / "01_coarse").mkdir(parents=True)
    save_alignment(
        registrations / "01_coarse" / "alignment.json", Transform("photo", "radar", matrix)
    )
    np.testing.assert_allclose(open_capture(mine).transform().matrix, matrix, atol=1e-12)
    (mine / "metadata.json").write_text('{"calibration": "../../../secret"}')
    with pytest.raises(HandbenchError, match="leaves the folder"):
        open_capture(mine).transform()


def test_the_whole_mesh_stands_in_for_a_masked_one_and_no_other_does(mine, capsys):
    (mine / "photogrammetry" / MESHES["masked"]).unlink()
    assert open_capture(mine).mesh().name == "mesh.obj"
    assert "has no mesh_masked.obj; mesh.obj is taken" in capsys.readouterr().err
    (mine / "photogrammetry" / MESHES["whole"]).unlink()
    assert open_capture(mine).mesh() is None


@pytest.mark.parametrize(
    "change, reason",
    [
        (
            {"xr": np.zeros((94, 94, 6), np.complex64)},
            r"'xr' is complex64 \(94, 94, 6\); expected .* \(96, 96, 6\)",
        ),
        ({"xr": np.zeros((96, 96, 6))}, "'xr' is float64"),
        (
            {"xr": np.full((96, 96, 6), np.nan + 0j)},
            "calibrated_data: samples: 53016 of 53016 are NaN",
        ),
        ({"fvec": TONES_HZ / 1e9}, "'fvec' is float64 from 72 to 82; expected hertz"),
        ({"number_of_measurements": 0}, "'number_of_measurements' is 0"),
        ({"number_of_measurements": np.nan}, "'number_of_measurements' is nan"),
        ({"number_of_measurements": 2}, "000001.npy: expected a radar frame"),
        ({"fvec": "72e9"}, "'fvec' is <U4"),
    ],
)
def test_frames_that_are_not_the_radar_s_are_refused(mine, change, reason):
    file = next(mine.glob("radar_*/calibrated_data/000000.npy"))
    (file.parent / "000001.npy").unlink()
    content = {
        "fvec": TONES_HZ,
        "xr": np.ones((96, 96, 6), np.complex64),
        "number_of_measurements": 1,
    } | change
    np.save(file, np.array(content, dtype=object), allow_pickle=True)
    with pytest.raises(HandbenchError, match=reason) as caught:
        open_capture(mine).echoes()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "volume, reason",
    [
        ({"bb_min": [0, 0, 0], "bb_max": [1, 1, 1], "grid_size": [2, 2, 0]}, "whole numbers"),
        ({"bb_min": [0, 0, 0], "bb_max": [1, 1, 1], "grid_size": [2, 2]}, "'grid_size'"),
        ({"bb_min": [0, 0, 2], "bb_max": [1, 1, 1], "grid_size": [2, 2, 2]}, "bb_min below bb_max"),
        ([1], "'bb_min' is None"),
    ],
)
def test_boxes_that_are_none_are_refused(mine, volume, reason):
    next(mine.glob("radar_*")).joinpath("calibration.json").write_text(
        json.dumps({"000000": {"volume": volume}})
    )
    with pytest.raises(HandbenchError, match=reason):
        configuration(mine, "3fsk", {})


def test_the_key_minds_what_a_run_reads_and_nothing_else(mine):
    before = open_capture(mine).key(1)
    radar = next(mine.glob("radar_*"))
    (radar / "depth").mkdir()
    (radar / "depth" / "000000.png").write_bytes(b"made by their tools")
    (radar / "calibrated_data" / "000001.npy").write_bytes(b"not among the first frames")
    assert open_capture(mine).key(1) == before
    assert open_capture(mine).key(2) != before
    for file in (
        mine / "metadata.json",
        mine / "alignment.json",
        radar / "calibration.json",
        mine / "photogrammetry" / "mesh_masked.obj",
        radar / "calibrated_data" / "000000.npy",
    ):
        kept = file.read_bytes()
        file.write_bytes(kept + b" ")
        assert open_capture(mine).key(1) != before, file
        file.write_bytes(kept)
    assert open_capture(mine).key(1) == before


def depth_map(z_m) -> DepthMap:
    ny, nx = z_m.shape
    x_m, y_m = (0.001 * (np.arange(n) - n // 2) for n in (nx, ny))
    return DepthMap(x_m, y_m, z_m, np.zeros_like(z_m), "test")


def test_the_mask_is_their_box_and_their_erosion(mine):
    z_m = np.full((21, 21), 0.3)
    z_m[0], z_m[-1], z_m[10, 10] = np.nan, 0.8, 0.2
    (mine / "metadata.json").write_text(
        '{"distance_meters": 0.3, "mask_erosion": 20}'
    )  # zmin 0.26, zmax 0.7
    found = open_capture(mine).mask(depth_map(z_m))
    assert found.sum() == 19 * 21 - 1
    # Eroded by 5 × 5: rows 1 to 20 are on target, of which 3 to 20 stay (the border erodes
    # nothing); then the box takes row 20 and the near pixel.
    assert open_capture(mine).mask(depth_map(z_m), erode=True).sum() == 17 * 21 - 1
    (mine / "metadata.json").write_text('{"distance_meters": 0.3, "mask_bb": {"xmin": 0.0045}}')
    found = open_capture(mine).mask(depth_map(z_m))
    assert found[:, :6].sum() > 0 and not found[:, 6:].any()  # their xmin is our xmax
    (mine / "metadata.json").write_text('{"mask_bb": {"zmin": 0.23, "zmax": 0.1}}')
    with pytest.raises(HandbenchError, match=r"zmax 0\.1 below zmin 0\.23"):
        open_capture(mine).mask(depth_map(z_m))


def test_erosion_leaves_more_than_ten_pixels():
    mask = np.zeros((20, 20), bool)
    mask[5:11, 5:11] = True
    assert eroded(mask, 3).sum() == 16
    assert eroded(mask, 5).sum() == 16  # 5 × 5 would leave 4, 4 × 4 leaves 9: too few
    np.testing.assert_array_equal(eroded(mask, 0), mask)
    np.testing.assert_array_equal(
        eroded(mask, 2), np.pad(np.ones((5, 5), bool), ((5, 10), (5, 10)))
    )
    small = np.zeros((20, 20), bool)
    small[3:6, 3:6] = True
    np.testing.assert_array_equal(eroded(small, 5), small)


def test_an_object_becomes_a_capture_folder(written, tmp_path):
    import_capture("maroon", written[1], tmp_path / "native")
    native, maroon = open_capture(tmp_path / "native"), open_capture(written[1])
    assert type(native) is NativeCapture
    assert native.about.contains == ("echoes.h5", "mesh.ply", "radar_from_photo.json")
    assert native.about.model_copy(update={"contains": ()}) == maroon.about
    np.testing.assert_array_equal(native.echoes().samples, maroon.echoes().samples)
    np.testing.assert_allclose(native.transform().matrix, maroon.transform().matrix, atol=1e-15)
    grid = PixelGrid(np.linspace(-0.039, -0.021, 5), np.linspace(0.011, 0.029, 5))
    depths = [reference_of_file(c.mesh(), c.transform(), grid).z_m for c in (native, maroon)]
    np.testing.assert_allclose(*depths, atol=1e-7)  # the mesh is written in float32
    with pytest.raises(HandbenchError, match="is no capture of 'mapping' but of MaroonCapture"):
        import_capture("mapping", written[1], tmp_path / "other")


def test_captures_of_a_data_set(written, tmp_path):
    root = tmp_path / "maroon"
    for folder in (
        "02_hand/30",
        "02_hand/100",
        "10_cup/30",
        "00_registration/01_coarse/30",
        "01_empty/30",
    ):
        shutil.copytree(written[1], root / folder)
    (root / "01_empty" / "30" / "metadata.json").unlink()
    (root / "readme").mkdir()

    def found(*selection):
        return [str(folder.relative_to(root)) for folder in captures(root, *selection)]

    assert found() == ["02_hand/30", "02_hand/100", "10_cup/30"]
    assert found(["10_cup"]) == ["10_cup/30"]
    assert found([], [30]) == ["02_hand/30", "10_cup/30"]
    assert captures(root / "10_cup" / "30") == [root / "10_cup" / "30"]
    with pytest.raises(HandbenchError, match="did you mean '02_hand'"):
        found(["02_hands"])
    with pytest.raises(HandbenchError, match="folders with captures: 100, 30"):
        found([], [70])
    with pytest.raises(HandbenchError, match=r"is no capture; expected capture\.toml"):
        open_capture(root)
