"""The CUDA path of the dense stage: COLMAP's files and failures, and COLMAP where CUDA is."""

import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth import pipeline
from handbench.groundtruth.cameras import cuda_devices, pycolmap
from handbench.groundtruth.dense import cuda
from handbench.groundtruth.options import Options
from tests.groundtruth import ball
from tests.refusals import refuse

SIZES = ((112, 112), (104, 112), (112, 96), (96, 104), (112, 112))


def test_colmap_gets_our_views_and_its_maps_are_refined(monkeypatch):
    """In place of COLMAP: true maps, 0.1 % off."""
    views, sources = ball.scene(SIZES)

    def search(folder, options):
        model = pycolmap.Reconstruction(folder / "sparse")
        for i, view in enumerate(views):
            pose = model.images[i + 1].cam_from_world().matrix()
            np.testing.assert_allclose(pose, np.column_stack([view.R, view.t]), atol=1e-12)
            np.testing.assert_allclose(model.cameras[i + 1].calibration_matrix(), view.K)
            picture = np.asarray(Image.open(folder / "images" / f"{i}.png"))
            assert picture.shape == (112, 112)
            height, width = view.gray.shape
            shades = 255 * view.gray.clip(0, 1)
            np.testing.assert_allclose(picture[:height, :width], shades, atol=0.51)  # rounded
            depth_m, _, normals, _ = ball.surface(view)
            written = pycolmap.DepthMap.from_array((0.999 * depth_m).astype(np.float32), 0.4, 0.62)
            written.write(folder / f"stereo/depth_maps/{i}.png.geometric.bin")
            written = pycolmap.NormalMap.from_array((normals @ view.R.T).astype(np.float32))
            written.write(folder / f"stereo/normal_maps/{i}.png.geometric.bin")
        assert (options["depth_min"], options["depth_max"]) == pytest.approx((0.40, 0.62))
        lines = (folder / "stereo" / "patch-match.cfg").read_text().splitlines()
        assert lines[:2] == ["0.png", ", ".join(f"{source}.png" for source in sources[0])]

    monkeypatch.setattr(cuda, "search", search)
    ball.check(cuda.depth_maps(views, sources), known=0.55, rim=0.3, angle_deg=12, points=2500)


def test_maps_that_are_missing_are_named(tmp_path):
    refuse(lambda: cuda.read_maps(tmp_path, ball.scene()[0], 1, []), "v1")


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
    maps = cuda.depth_maps(*ball.scene(SIZES))
    ball.check(maps, known=0.55, rim=0.3, angle_deg=12, points=2500)
