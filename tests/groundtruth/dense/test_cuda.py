"""The CUDA path of the dense stage: COLMAP's files and failures, and COLMAP where CUDA is."""

import numpy as np
import pytest

from handbench.groundtruth import pipeline
from handbench.groundtruth.cameras.cameras import cuda_devices
from handbench.groundtruth.dense import cuda
from handbench.groundtruth.options import Options
from handbench.support.errors import HandbenchError
from tests.groundtruth import ball


@pytest.mark.parametrize("content", [b"", b"3&2&1&" + bytes(23), b"2&3&1&" + bytes(24)])
def test_a_broken_map_is_refused(tmp_path, content):
    (tmp_path / "0.png.geometric.bin").write_bytes(content)
    with pytest.raises(HandbenchError, match=r"0\.png\.geometric\.bin"):
        cuda.read_map(tmp_path / "0.png.geometric.bin", (2, 3, 1))


def test_a_map_is_read_by_channel_row_and_column(tmp_path):
    values = np.arange(6, dtype="<f4").tobytes()
    (tmp_path / "a.bin").write_bytes(b"3&1&2&" + values)
    assert cuda.read_map(tmp_path / "a.bin", (1, 3, 2)).tolist() == [[[0, 3], [1, 4], [2, 5]]]


@pytest.mark.parametrize(
    ("ending", "reason"),
    [("raise ValueError('no kernel image')", "no kernel image"), ("os.abort()", "exit code -6")],
)
def test_a_search_that_ends_its_process_is_one_line(tmp_path, monkeypatch, ending, reason):
    (tmp_path / "pycolmap.py").write_text(
        f"import os\nPatchMatchOptions = dict\ndef patch_match_stereo(*_, **options): {ending}\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(HandbenchError, match=reason):
        cuda.search(tmp_path, {"depth_min": 0.4})


def test_cuda_without_a_device_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "cuda_devices", lambda: 0)
    with pytest.raises(HandbenchError, match="dense: CUDA"):
        pipeline.perform(tmp_path, tmp_path, Options(dense="cuda"))


def test_colmap_finds_the_sphere_on_a_gpu():
    if not cuda_devices():
        pytest.skip("pycolmap finds no CUDA device")
    views, depths_m, sources = ball.scene(
        [(112, 112), (104, 112), (112, 96), (96, 104), (112, 112)]
    )
    maps = cuda.depth_maps(views, sources, "normal")
    ball.check(maps, depths_m, known=0.55, rim=0.3, angle_deg=12, points=2500)
