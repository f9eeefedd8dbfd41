"""The CUDA path of the dense stage: with a stand-in that writes what COLMAP would, and with COLMAP
where CUDA is."""

from pathlib import Path

import numpy as np
import pytest

from handbench.groundtruth.cameras.cameras import cuda_devices, load_pycolmap
from handbench.groundtruth.dense import cuda
from handbench.groundtruth.options import Options
from handbench.groundtruth.photos.photos import read_gray
from handbench.groundtruth.sparse import inputs
from handbench.support.errors import HandbenchError
from tests.groundtruth import ball
from tests.groundtruth.ball import DISPARITY_M, RADIUS_M, surface
from tests.groundtruth.room import photograph

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
    return ball.scene(SIZES)


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


def right(maps, depths_m):
    """Check that the maps are as good as the processor's."""
    ball.check(maps, depths_m, known=0.55, rim=0.3, angle_deg=12, points=2500)


@pytest.mark.slow
def test_maps_are_of_the_views_and_right(scene, monkeypatch):
    """COLMAP gets the pictures, each view's sources and options that it knows."""
    views, depths_m, sources = scene

    def search(workspace, options):
        load_pycolmap().PatchMatchOptions(**options)
        assert (options["depth_min"], options["depth_max"]) == pytest.approx((0.40, 0.62))
        lines = (workspace / "stereo" / "patch-match.cfg").read_text().splitlines()
        assert lines[::2] == [f"{i}.png" for i in range(5)]
        assert sorted(lines[1].split(", ")) == ["1.png", "2.png", "3.png", "4.png"]
        for i, seen in enumerate(views):
            padding = [(0, 112 - size) for size in seen.gray.shape]
            picture = read_gray(workspace / "images" / f"{i}.png")
            assert np.abs(picture - np.pad(seen.gray.clip(0, 1), padding)).max() < 0.51 / 255
        stand_in(workspace, options)

    monkeypatch.setattr(cuda, "search", search)
    maps = cuda.depth_maps(views, sources, "high")
    assert [m.view for m in maps] == list(views)
    right(maps, depths_m)
    for m in maps:
        assert np.isnan(m.depth_m[HOLE]).all() and np.isnan(m.depth_m[FAR]).all()


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


@pytest.mark.parametrize(
    "content",
    [None, b"3&2&1&", b"3&2&1&" + bytes(23), b"3&2&1&" + bytes(25), b"2&3&1&" + bytes(24)],
    ids=["missing", "header alone", "truncated", "too long", "turned"],
)
def test_a_broken_map_is_refused(tmp_path, content):
    file = tmp_path / "0.png.geometric.bin"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(
        HandbenchError, match=r"0\.png\.geometric\.bin: is missing or has .*3 × 2.*dense=.cpu."
    ):
        cuda.read_map(file, (2, 3, 1))


@pytest.mark.parametrize(
    ("ending", "reason"),
    [
        ("raise ValueError('no kernel image')", "ValueError: no kernel image"),
        ("print('Check failed: full', file=sys.stderr, flush=True); os.abort()", "Check failed"),
        ("os.abort()", "exit code -6"),
    ],
)
def test_a_search_that_ends_its_process_is_one_line(tmp_path, monkeypatch, ending, reason):
    """Options and folder reach the process."""
    options = {"depth_min": 0.4, "num_iterations": 5, "geom_consistency": True}
    (tmp_path / "pycolmap.py").write_text(
        "import os, sys\nPatchMatchOptions = dict\ndef patch_match_stereo(folder, options):\n"
        f"    if (folder, options) == ({str(tmp_path)!r}, {options}):\n        {ending}\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(
        HandbenchError,
        match=rf"COLMAP's stereo search failed on the CUDA device \({reason}.*dense=.cpu.",
    ):
        cuda.search(tmp_path, options)


@pytest.mark.parametrize(
    ("choice", "devices", "place"),
    [("auto", 0, "cpu"), ("auto", 2, "cuda"), ("cpu", 2, "cpu"), ("cuda", 1, "cuda")],
)
def test_where_depth_maps_are_made(tmp_path, monkeypatch, choice, devices, place):
    """Without a device CUDA is refused before the work."""
    photograph(tmp_path, size=(160, 120))
    monkeypatch.setattr(inputs, "cuda_devices", lambda: devices)
    assert inputs.resolve(tmp_path, Options(unscaled=True, dense=choice))[1].dense == place
    monkeypatch.setattr(inputs, "cuda_devices", lambda: 0)
    with pytest.raises(
        HandbenchError, match=r"dense: CUDA is requested.*handbench\[cuda\].*leave the option out"
    ):
        inputs.resolve(tmp_path, Options(dense="cuda"))


@pytest.mark.parametrize("quality", ["draft", "normal"])
def test_colmap_finds_the_sphere_on_a_gpu(scene, quality):
    if not cuda_devices():
        pytest.skip("pycolmap finds no CUDA device: COLMAP's stereo itself was not run")
    views, depths_m, sources = scene
    right(cuda.depth_maps(views, sources, quality), depths_m)
