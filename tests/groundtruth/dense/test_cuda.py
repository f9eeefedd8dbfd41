"""The CUDA path of the dense stage: with a stand-in that writes what COLMAP would, and with COLMAP
where CUDA is."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.groundtruth import dense_stage, pipeline
from handbench.groundtruth.cameras.cameras import cuda_devices, load_pycolmap
from handbench.groundtruth.dense import cuda, dense
from handbench.groundtruth.dense.dense import choose_sources
from handbench.groundtruth.dense.first_guess import planes_through
from handbench.groundtruth.dense.fusion import fuse
from handbench.groundtruth.options import Options
from handbench.groundtruth.photos.photos import read_gray
from handbench.groundtruth.sparse import inputs
from handbench.support.errors import HandbenchError
from tests.groundtruth.ball import ANGLES, DISPARITY_M, RADIUS_M, surface, view

SIZES = [
    (112, 112),
    (104, 112),
    (112, 96),
    (96, 104),
    (112, 112),
]  # boxes cut every picture to a size of its own
HOLE, FAR = (
    np.s_[40:48, 40:48],
    np.s_[60:68, 40:48],
)  # where the stand-in found nothing, or what lies out of range


@pytest.fixture(scope="module")
def scene():
    views, depths_m = zip(
        *(
            view(f"v{i}", *pair, *size)
            for i, (pair, size) in enumerate(zip(ANGLES, SIZES, strict=True))
        ),
        strict=True,
    )
    points_m = np.random.default_rng(0).normal(scale=0.04, size=(50, 3))
    return (
        list(views),
        depths_m,
        choose_sources(list(views), np.ones((50, 5), dtype=bool), points_m),
    )


def write_map(file: Path, values: np.ndarray) -> None:
    """As COLMAP does: channel by channel, row by row."""
    height, width, channels = values.shape
    head = f"{width}&{height}&{channels}&".encode()
    file.write_bytes(head + np.moveaxis(values, -1, 0).astype("<f4").tobytes())


def stand_in(workspace: Path, options: dict) -> None:
    """COLMAP's search: depths at whole-numbered pixels and normals from what the workspace says,
    each a little off."""
    off = options.get("off", 0.2)  # disparities; the normals are then off by 9° in the median
    kind = "geometric" if options["geom_consistency"] else "photometric"
    random = np.random.default_rng(1)
    model = load_pycolmap().Reconstruction(str(workspace / "sparse"))
    for image in model.images.values():
        camera, pose = image.camera, image.cam_from_world()
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        fx, fy, cx, cy = camera.params
        rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], axis=-1)
        R = pose.rotation.matrix()
        depth_m, normals = surface(rays, R, pose.translation)
        depth_m += off * DISPARITY_M * random.uniform(-1, 1, depth_m.shape)
        normals += off * random.uniform(-1, 1, normals.shape)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        depth_m[HOLE], normals[HOLE] = 0, 0
        depth_m[FAR] = 1.0
        write_map(
            workspace / "stereo" / "depth_maps" / f"{image.name}.{kind}.bin", depth_m[..., None]
        )
        write_map(workspace / "stereo" / "normal_maps" / f"{image.name}.{kind}.bin", normals @ R.T)


def right(maps: list[dense.ViewDepth], depths_m: tuple[np.ndarray, ...]) -> None:
    """Check that the maps are as good as the processor's."""
    for m, depth_m in zip(maps, depths_m, strict=True):
        known = np.isfinite(m.depth_m)
        error = np.abs(m.depth_m - depth_m)[known] / DISPARITY_M
        _, normals = surface(m.view.rays(), m.view.R, m.view.t)
        assert m.depth_m.shape == m.view.gray.shape and known.mean() > 0.55
        assert np.median(error) < 0.05 and np.quantile(error, 0.95) < 0.3
        assert (
            np.median(
                np.degrees(np.arccos(np.clip((m.normals * normals).sum(axis=-1)[known], -1, 1)))
            )
            < 12
        )
    cloud = fuse(maps, np.array([[-0.05, -0.05, -0.1], [0.05, 0.05, -0.02]]))
    error = np.abs(np.linalg.norm(cloud.points_m, axis=1) - RADIUS_M) / DISPARITY_M
    assert len(cloud.points_m) > 2500 and np.median(error) < 0.05 and np.quantile(error, 0.99) < 0.3


@pytest.mark.parametrize("quality", ["draft", "normal"])
def test_maps_are_of_the_views_and_right(scene, monkeypatch, quality):
    views, depths_m, sources = scene
    monkeypatch.setattr(cuda, "search", stand_in)
    maps = cuda.depth_maps(views, sources, quality)
    assert [m.view for m in maps] == views
    right(maps, depths_m)
    for m in maps:
        assert np.isnan(m.depth_m[HOLE]).all() and np.isnan(m.depth_m[FAR]).all()


def test_the_workspace_holds_the_views(scene, tmp_path):
    """Cameras with K as it is, and pictures of one size."""
    views, *_ = scene
    cuda.write_workspace(tmp_path, views, [[1], [0], [0], [0], [0]])
    model = load_pycolmap().Reconstruction(str(tmp_path / "sparse"))
    assert len(model.images) == len(views)
    for i, seen in enumerate(views):
        [image] = [image for image in model.images.values() if image.name == f"{i}.png"]
        pose = image.cam_from_world()
        np.testing.assert_allclose(image.camera.calibration_matrix(), seen.K, atol=1e-12)
        np.testing.assert_allclose(pose.rotation.matrix(), seen.R, atol=1e-12)
        np.testing.assert_allclose(pose.translation, seen.t, atol=1e-12)
        picture = read_gray(tmp_path / "images" / image.name)
        assert picture.shape == (112, 112) == (image.camera.height, image.camera.width)
        h, w = seen.gray.shape
        assert np.abs(picture[:h, :w] - seen.gray.clip(0, 1)).max() < 0.51 / 255
        assert not picture[h:].any() and not picture[:, w:].any()


def test_colmap_itself_reads_the_stand_in_s_maps_so(scene, tmp_path):
    """Its fusion of single pixels puts them on the sphere: layout, frames and whole-numbered
    centres are COLMAP's."""
    views, *_ = scene
    cuda.write_workspace(tmp_path, views, [[1], [0], [0], [0], [0]])
    stand_in(tmp_path, {"geom_consistency": False, "off": 0})
    (tmp_path / "stereo" / "fusion.cfg").write_text(
        "".join(f"{i}.png\n" for i in range(len(views)))
    )
    colmap = load_pycolmap()
    colmap.logging.minloglevel = int(colmap.logging.FATAL)
    options = colmap.StereoFusionOptions(min_num_pixels=1, num_threads=1)
    (tmp_path / "fused").mkdir()
    fused = colmap.stereo_fusion(
        tmp_path / "fused", tmp_path, input_type="photometric", options=options
    )
    points_m = np.array([point.xyz for point in fused.points3D.values()])
    on_sphere = points_m[:, 2] < 0
    error_m = np.abs(np.linalg.norm(points_m[on_sphere], axis=1) - RADIUS_M)
    assert on_sphere.sum() > 3000 and error_m.max() < 1e-6


def test_what_colmap_is_told(scene, monkeypatch):
    views, _, sources = scene
    told = {}

    def search(workspace, options):
        told.update(options, sources=(workspace / "stereo" / "patch-match.cfg").read_text())
        stand_in(workspace, options)

    monkeypatch.setattr(cuda, "search", search)
    cuda.depth_maps(views, sources, "high")
    assert told["geom_consistency"] and told["num_iterations"] == 5 and told["window_radius"] == 3
    assert told["depth_min"] == pytest.approx(0.40) and told["depth_max"] == pytest.approx(0.62)
    names, lists = told["sources"].splitlines()[::2], told["sources"].splitlines()[1::2]
    assert names == [f"{i}.png" for i in range(5)]
    assert sorted(lists[0].split(", ")) == ["1.png", "2.png", "3.png", "4.png"]
    load_pycolmap().PatchMatchOptions(
        **{key: told[key] for key in told if key != "sources"}
    )  # COLMAP knows them all


@pytest.mark.parametrize(
    "content",
    [
        None,
        b"",
        b"3&2&1&",
        b"3&2&1&" + bytes(23),
        b"3&2&1&" + bytes(25),
        b"2&3&1&" + bytes(24),
        b"3&2&3&" + bytes(24),
        b"\x89PNG\r\n" + bytes(24),
    ],
    ids=[
        "missing",
        "empty",
        "header alone",
        "truncated",
        "too long",
        "turned",
        "channels",
        "another format",
    ],
)
def test_a_broken_map_is_refused(tmp_path, content):
    file = tmp_path / "0.png.geometric.bin"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(
        HandbenchError, match=r"0\.png\.geometric\.bin: is missing or broken .*3 × 2.*--dense cpu"
    ):
        cuda.read_map(file, (2, 3, 1))


def test_a_map_is_read_by_channel_row_and_column(tmp_path):
    values = np.arange(18.0).reshape(2, 3, 3)
    write_map(tmp_path / "n.bin", values)
    np.testing.assert_array_equal(cuda.read_map(tmp_path / "n.bin", (2, 3, 3)), values)
    load_pycolmap().DepthMap.from_array(values[..., 0].astype(np.float32), 0.0, 1.0).write(
        tmp_path / "d.bin"
    )
    np.testing.assert_array_equal(
        cuda.read_map(tmp_path / "d.bin", (2, 3, 1))[..., 0], values[..., 0]
    )


@pytest.mark.parametrize("depth_m", [np.nan, np.inf, 0.0, -0.5, 0.39, 0.63])
def test_depths_that_are_of_no_interest_are_no_surface(scene, depth_m):
    first = scene[0][0]
    depths_m = np.full(first.gray.shape, depth_m)
    normals = np.broadcast_to((0.0, 0.0, -1.0), (*depths_m.shape, 3))
    assert np.isnan(planes_through(first, depths_m, normals, 1.0)).all()
    depths_m[:] = 0.5
    assert np.isfinite(planes_through(first, depths_m, normals, 1.0)).all()
    assert np.isnan(planes_through(first, depths_m, -normals, 1.0)).all()  # away from the camera


@pytest.mark.parametrize(
    ("ending", "reason"),
    [
        ("raise ValueError('no kernel image')", "ValueError: no kernel image"),
        (
            "import os, sys; print('Check failed: full', file=sys.stderr, flush=True); os.abort()",
            "Check failed: full",
        ),
        ("import os; os.abort()", "exit code -6"),
    ],
)
def test_a_search_that_ends_its_process_is_one_line(tmp_path, monkeypatch, ending, reason):
    fake = tmp_path / "pycolmap.py"
    fake.write_text(
        "def PatchMatchOptions(**o): return o\ndef patch_match_stereo(folder, options):\n    "
        f"{ending}\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(
        HandbenchError, match=rf"COLMAP's stereo failed on the CUDA device \({reason}.*--dense cpu"
    ):
        cuda.search(tmp_path, {})


def test_the_search_hands_everything_on(tmp_path, monkeypatch):
    (tmp_path / "pycolmap.py").write_text(
        "import json\n"
        "PatchMatchOptions = dict\n"
        "def patch_match_stereo(folder, options):\n"
        "    with open(folder + '/told.json', 'w') as file: json.dump(options, file)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    options = {"depth_min": 0.4, "num_iterations": 5, "geom_consistency": True}
    cuda.search(tmp_path, options)
    assert json.loads((tmp_path / "told.json").read_text()) == options


@pytest.mark.parametrize(
    ("choice", "devices", "place"),
    [("auto", 0, "cpu"), ("auto", 2, "cuda"), ("cpu", 2, "cpu"), ("cuda", 1, "cuda")],
)
def test_where_depth_maps_are_made(room_options, monkeypatch, choice, devices, place):
    monkeypatch.setattr(inputs, "cuda_devices", lambda: devices)
    _, options = inputs.resolve(*room_options(choice))
    assert options.dense == place


def test_cuda_without_cuda_is_refused_before_the_work(room_options, monkeypatch):
    monkeypatch.setattr(inputs, "cuda_devices", lambda: 0)
    with pytest.raises(
        HandbenchError, match=r"dense: cuda is asked for.*handbench\[cuda\].*leave the option out"
    ):
        pipeline.reconstruct(*room_options("cuda"))


def test_the_command_refuses_in_one_line(room_options, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(inputs, "cuda_devices", lambda: 0)
    photos, _ = room_options("cuda")
    assert (
        main(
            [
                "groundtruth",
                str(photos),
                "-o",
                str(tmp_path / "m.ply"),
                "--unscaled",
                "--dense",
                "cuda",
            ]
        )
        == 2
    )
    assert (
        capsys.readouterr().err.splitlines()[-1].startswith("handbench: dense: cuda is asked for")
    )


@pytest.fixture
def room_options(tmp_path):
    """Photographs of the room's corner and options with a choice of where to make depth maps."""
    from tests.groundtruth.room import photograph

    photograph(tmp_path, size=(160, 120))
    return lambda choice: (tmp_path, Options(unscaled=True, dense=choice))


def test_the_pipeline_takes_the_maps_from_cuda(scene, monkeypatch):
    views, _, sources = scene
    monkeypatch.setattr(dense_stage, "open_views", lambda *_: (views, sources))
    monkeypatch.setattr(cuda, "search", stand_in)
    monkeypatch.setattr(
        dense_stage, "depth_maps", lambda *_: pytest.fail("the processor's depth maps")
    )
    solved = SimpleNamespace(model=None)
    cloud = dense_stage.dense_cloud((), solved, Options(dense="cuda", quality="draft"))
    on_sphere = cloud.points_m[:, 2] < -0.02
    assert on_sphere.sum() > 1000
    assert (
        np.median(np.abs(np.linalg.norm(cloud.points_m[on_sphere], axis=1) - RADIUS_M))
        < 0.05 * DISPARITY_M
    )


def test_a_cloud_of_the_other_machine_is_not_taken_from_the_cache(tmp_path):
    chains = [
        pipeline.stages(tmp_path, tmp_path, Options(dense=place), ["photographs"])
        for place in ("cpu", "cuda")
    ]
    (sparse, mapped, mesh), (same, other, another) = chains
    assert sparse.key == same.key and mapped.key != other.key and mesh.key != another.key


@pytest.mark.parametrize("quality", ["draft", "normal"])
def test_colmap_finds_the_sphere_on_a_gpu(scene, quality):
    if not cuda_devices():
        pytest.skip("pycolmap finds no CUDA device: COLMAP's stereo itself was not run")
    views, depths_m, sources = scene
    right(cuda.depth_maps(views, sources, quality), depths_m)
