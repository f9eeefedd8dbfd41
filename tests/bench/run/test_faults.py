"""Faults around a run: each is one line, nothing half-made is taken for whole, and the next run
ends where an undisturbed one does."""

import os
import shutil
import tracemalloc
from collections import namedtuple
from pathlib import Path

import numpy as np
import psutil
import pytest

from handbench.cli.main import main
from handbench.groundtruth.mesh.surface import load_open3d, write_mesh
from handbench.radar.data.arrays import AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.support.store import MARKER, locked
from tests.bench.run.faults import content, execute, figures, files_of_at_most, instant
from tests.refusals import refuse, refuse_command


def test_a_full_disk_is_one_line_and_the_next_run_is_whole(
    small_bench, small_result, tmp_path, monkeypatch
):
    instant(small_result, monkeypatch)
    out = tmp_path / "out"
    command = ["run", str(small_bench), "-o", str(out)]
    with files_of_at_most(1000):
        refuse_command(command, str(out))
    assert not (out / "result.json").exists()
    assert {path.name for path in out.rglob(".*")} <= {MARKER}
    assert main(command) == 0
    assert content(out).keys() == content(small_result).keys()
    assert figures(out) == figures(small_result)


def test_a_second_run_into_the_folder_is_refused(small_bench, tmp_path):
    with locked(tmp_path / "out"):
        refuse_command(["run", str(small_bench), "-o", str(tmp_path / "out")], f"{tmp_path}/out")


def link_to_itself(file: Path, home: Path) -> None:
    file.rename(home / "same")
    file.symlink_to(home / "same")


def pipe(file: Path, home: Path) -> None:
    file.unlink()
    os.mkfifo(file)


@pytest.mark.parametrize("damage", [link_to_itself, pipe])
def test_a_stage_with_a_damaged_file_is_reported_and_made_again(
    small_bench, small_result, tmp_path, monkeypatch, capsys, damage
):
    """No link is followed: what it leads to is left alone."""
    instant(small_result, monkeypatch)
    out, home = tmp_path / "out", tmp_path / "home"
    shutil.copytree(small_result, out)
    home.mkdir()
    for name in ("depth.npz", "stage.json"):
        [file] = (out / "work").glob(f"reconstruct-ball-2fsk-*/{name}")
        damage(file, home)
        precious = content(home)
        made = execute(small_bench, out).tasks.query("not cached").task.tolist()
        assert made == ["reconstruct-ball-2fsk"]
        assert str(file.parent) in capsys.readouterr().err
        assert content(out) == content(small_result) and content(home) == precious


def test_echoes_beyond_memory_are_refused_before_it_is_taken(tmp_path, monkeypatch):
    """On a machine with 10 MB of memory, 1 MB of it free."""
    samples, places_m = np.ones((1, 2, 100_000), np.complex64), np.zeros((100_000, 3))
    echoes = RadarCapture(samples, np.array([1e9, 2e9]), AntennaPairs(places_m, places_m))
    save_capture(tmp_path / "echoes.h5", echoes)
    monkeypatch.delenv("HANDBENCH_MEMORY_GB", raising=False)
    free = namedtuple("Free", "available total")(1e6, 1e7)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: free)
    tracemalloc.start()
    try:
        refuse(lambda: load_capture(tmp_path / "echoes.h5"), "echoes.h5", "0.0048 GB")
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_a_full_disk_is_reported_and_leaves_no_file(tmp_path):
    """HDF5's library fails when it closes the file."""
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(0.02)
    echoes = RadarCapture(np.ones((1, 1, 94, 94), np.complex64), np.array([77e9]), qar50())
    with files_of_at_most(1000):
        refuse(lambda: write_mesh(tmp_path / "a.ply", sphere), "a.ply")
        refuse(lambda: save_capture(tmp_path / "a.h5", echoes), "a.h5")
    assert not list(tmp_path.iterdir())
