"""Faults around a run: each is one line, nothing half-made is taken for whole, and the next run
ends where an undisturbed one does. Kills are in test_resume, lost workers in test_schedule."""

import shutil
import tracemalloc
from collections import namedtuple

import numpy as np
import psutil
import pytest

from handbench.cli.main import main
from handbench.groundtruth.mesh.mesh_files import load_open3d, write_mesh
from handbench.radar.data.arrays import AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.support.errors import HandbenchError
from handbench.support.folder import MARKER, locked
from tests.bench.run.faults import content, execute, figures, files_of_at_most, instant


def test_a_full_disk_is_one_line_and_the_next_run_is_whole(
    small_bench, small_result, tmp_path, monkeypatch, capsys
):
    instant(small_result, monkeypatch)
    out = tmp_path / "out"
    command = ["run", str(small_bench), "-o", str(out)]
    with files_of_at_most(1000):
        assert main(command) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("handbench: ")
    assert not (out / "result.json").exists()
    assert {path.name for path in out.rglob(".*")} <= {MARKER}
    assert main(command) == 0
    assert content(out).keys() == content(small_result).keys()
    assert figures(out) == figures(small_result)


def test_a_second_run_into_the_folder_is_refused(small_bench, tmp_path, capsys):
    with locked(tmp_path / "out"):
        assert main(["run", str(small_bench), "-o", str(tmp_path / "out")]) == 2
    assert "another run is writing" in capsys.readouterr().err


def test_a_flipped_bit_in_a_kept_file_is_reported_and_made_again(
    small_bench, small_result, tmp_path, monkeypatch, capsys
):
    instant(small_result, monkeypatch)
    out = tmp_path / "out"
    shutil.copytree(small_result, out)
    for name in ("depth.npz", "stage.json"):
        [file] = (out / "work").glob(f"reconstruct-ball-2fsk-*/{name}")
        broken = bytearray(file.read_bytes())
        broken[len(broken) // 2] ^= 1
        file.write_bytes(broken)
        made = execute(small_bench, out).tasks.query("not cached").task.tolist()
        assert made == ["reconstruct-ball-2fsk"]
        assert "is computed again" in capsys.readouterr().err
        assert content(out) == content(small_result)


def test_echoes_beyond_memory_are_refused_before_it_is_taken(tmp_path, monkeypatch):
    """On a machine with 10 MB of memory, 1 MB of it free."""
    samples, scan = (
        np.ones((1, 2, 100_000), np.complex64),
        AntennaPairs(np.zeros((100_000, 3)), np.zeros((100_000, 3))),
    )
    save_capture(tmp_path / "echoes.h5", RadarCapture(samples, np.array([1e9, 2e9]), scan))
    monkeypatch.delenv("HANDBENCH_MEMORY_GB", raising=False)
    free = namedtuple("Free", "available total")(1e6, 1e7)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: free)
    tracemalloc.start()
    try:
        with pytest.raises(HandbenchError, match=r"needs 0\.0048 GB of memory"):
            load_capture(tmp_path / "echoes.h5")
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_a_full_disk_is_reported_and_leaves_no_file(tmp_path):
    """HDF5's library fails when it closes the file."""
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(0.02)
    echoes = RadarCapture(np.ones((1, 1, 94, 94), np.complex64), np.array([77e9]), qar50())
    for write, name, what in ((write_mesh, "a.ply", sphere), (save_capture, "a.h5", echoes)):
        with files_of_at_most(1000), pytest.raises(HandbenchError, match=name):
            write(tmp_path / name, what)
    assert not list(tmp_path.iterdir())
