"""The CUDA path of the dense stage: COLMAP's files and failures, and COLMAP where CUDA is."""

import numpy as np
import pytest

from handbench.groundtruth import pipeline
from handbench.groundtruth.cameras.cameras import cuda_devices, pycolmap
from handbench.groundtruth.dense import cuda
from handbench.groundtruth.options import Options
from tests.groundtruth import ball
from tests.refusals import refuse


def test_maps_that_colmap_wrote_are_refined(tmp_path):
    views, sources = ball.scene()
    depth_m, _, normals, _ = ball.surface(views[0])
    for kind, values, Map in (
        ("depth", 0.999 * depth_m, pycolmap.DepthMap),
        ("normal", normals @ views[0].R.T, pycolmap.NormalMap),
    ):
        file = tmp_path / "stereo" / f"{kind}_maps" / "0.png.geometric.bin"
        file.parent.mkdir(parents=True)
        limits = (0.4, 0.62) if kind == "depth" else ()
        Map.from_array(values.astype(np.float32), *limits).write(file)
    refined = cuda.read_maps(tmp_path, views, 0, sources[0])
    error = np.abs(refined.depth_m - depth_m) / ball.DISPARITY_M
    assert np.isfinite(error).mean() > 0.55 and np.nanmedian(error) < 0.05
    refuse(lambda: cuda.read_maps(tmp_path, views, 1, sources[1]), "v1")


@pytest.mark.parametrize(
    ("ending", "reason"),
    [("raise ValueError('no kernel image')", "no kernel image"), ("os.abort()", "exit code -6")],
)
def test_a_search_that_ends_its_process_is_refused(tmp_path, monkeypatch, ending, reason):
    (tmp_path / "pycolmap.py").write_text(
        f"import os\nPatchMatchOptions = dict\ndef patch_match_stereo(*_, **options): {ending}\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    refuse(lambda: cuda.search(tmp_path, {"depth_min": 0.4}), reason)


def test_cuda_without_a_device_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "cuda_devices", lambda: 0)
    refuse(lambda: pipeline.perform(tmp_path, tmp_path, Options(dense="cuda")), "dense: CUDA")


def test_colmap_finds_the_sphere_on_a_gpu():
    if not cuda_devices():
        pytest.skip("pycolmap finds no CUDA device")
    maps = cuda.depth_maps(*ball.scene(((112, 112), (104, 112), (112, 96), (96, 104), (112, 112))))
    ball.check(maps, known=0.55, rim=0.3, angle_deg=12, points=2500)
