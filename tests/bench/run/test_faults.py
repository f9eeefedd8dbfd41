"""Faults around a run: each is reported in one line, nothing half-made is taken for whole, and a
resumed run ends where an undisturbed one does.

Elsewhere: kill −9 (test_resume), lost workers (test_schedule), limits of volumes (test_imaging),
two runs at once (tests/faults).
"""

import shutil
import tracemalloc
from collections import namedtuple
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest

from handbench.bench.run.write_result import tabulate
from handbench.groundtruth.cameras.camera_files import write_model
from handbench.groundtruth.dense.planesweep import swept_disparity
from handbench.groundtruth.dense.views import Stereo
from handbench.groundtruth.mesh.mesh_files import load_open3d, write_mesh
from handbench.radar.data.arrays import PlanarScan, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder
from handbench.support.store import MANIFEST
from tests.bench.run.faults import DISK, content, execute, instant, nobody_s_rights
from tests.faults.disk import files_of_at_most
from tests.fuzz.geometry_seeds import colmap_model

ROOT = Path(__file__).parents[3]


@pytest.fixture
def clean(small_bench, tmp_path, monkeypatch) -> Path:
    """The result of an undisturbed run of one method, which others then repeat without its work,
    nor forming the table of the same scores anew."""
    known: dict[str, pd.DataFrame] = {}

    def once(outcome, on, scores):
        about = f"{on} {outcome.failures}"
        known[about] = known[about] if about in known else tabulate(outcome, on, scores)
        return known[about]

    monkeypatch.setattr("handbench.bench.run.write_result.tabulate", once)
    small_bench.write_text(small_bench.read_text().rpartition("[[method]]")[0])
    execute(small_bench, tmp_path / "clean")
    instant(tmp_path / "clean", monkeypatch)
    return tmp_path / "clean"


@pytest.mark.parametrize(("rename", "step"), [(False, 7), (True, 4)], ids=["files", "renames"])
def test_a_disk_full_at_any_write_leaves_nothing_half_made(
    small_bench, clean, tmp_path, rename, step
):
    """At the first write, and so on by steps (`make faults` takes every one), until none is left to
    fail."""
    expected, at, words = content(clean), 1 - step, "…"
    while words:
        at, words = at + step, ""
        out = tmp_path / f"full{at}"
        with DISK.full(out, at, rename):
            try:  # what one stage could not write is recorded, where others could
                failures = execute(small_bench, out).about.failures
                words = "".join(failure.message for failure in failures)
            except HandbenchError as error:
                words = str(error)
                assert not (out / "result.json").exists()
        if words:
            assert "No space left" in words and "\n" not in words
            execute(small_bench, out)
        assert content(out) == expected
        shutil.rmtree(out)
    assert at > (15 if rename else 30)  # the run has that many


def test_a_flipped_bit_in_any_kept_file_is_found_reported_and_made_again(
    small_bench, clean, tmp_path, capsys
):
    out, expected, generator = tmp_path / "out", content(clean), np.random.default_rng(5)
    shutil.copytree(clean, out)
    files = sorted(file for file in (out / "work").rglob("*") if file.is_file())
    assert len(files) > 12
    for file in files:
        broken = bytearray(file.read_bytes())
        broken[generator.integers(len(broken))] ^= 1 << generator.integers(8)
        file.write_bytes(broken)
        capsys.readouterr()
        [made] = execute(small_bench, out).tasks.query("not cached").task.tolist()
        stage, lines = file.relative_to(out / "work").parts[0], capsys.readouterr().err.splitlines()
        assert stage.startswith(made)
        [line] = [line for line in lines if "is computed again" in line]
        # which a broken manifest cannot name
        assert stage in line and (file.name in line or file.name == MANIFEST)
        assert content(out) == expected


def test_a_folder_that_is_read_only_is_one_line(small_bench, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    out.chmod(0o555)
    words = r"out: cannot be written \(Permission denied\)"
    with nobody_s_rights(), pytest.raises(HandbenchError, match=words):
        execute(small_bench, out)
    assert not list(out.iterdir())


def echoes(file):
    samples, scan = np.ones((1, 2, 100_000), np.complex64), PlanarScan(np.zeros((100_000, 3)))
    save_capture(file, RadarCapture(samples, np.array([1e9, 2e9]), scan))
    del samples, scan
    tracemalloc.reset_peak()
    return load_capture(file)


def planes(_):
    picture, centre = np.zeros((60, 80), np.float32), np.array([[60, 80]])
    one = Stereo(picture, picture[None], centre, np.eye(3)[None], np.zeros((1, 3)), unit=1.0)
    return swept_disparity(one, 0.0, 256)


ECHOES = r"h5: 'samples' \(1, 2, 100000\): needs 0\.0032 GB of memory, but only 0\.001 GB are free"
PLANES = r"256 planes of 80 × 60 pixels: needs 0\.00492 GB .* free; choose a lower"
LARGE = {"echoes": (echoes, ECHOES), "planes": (planes, PLANES)}
Free = namedtuple("Free", "available total")


@pytest.mark.parametrize(("work", "words"), LARGE.values(), ids=LARGE)
def test_what_is_beyond_memory_is_refused_before_it_is_taken(tmp_path, monkeypatch, work, words):
    """On a machine with 10 MB of memory, 1 MB of it free."""
    monkeypatch.delenv("HANDBENCH_MEMORY_GB", raising=False)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: Free(1e6, 1e7))
    tracemalloc.start()
    try:
        with pytest.raises(HandbenchError, match=words):
            work(tmp_path / "echoes.h5")
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def write_cameras(path):
    with atomic_folder(path) as folder:
        write_model(colmap_model(), folder)


@pytest.mark.parametrize("size", [100, 1000])
def test_libraries_that_do_not_mind_a_full_disk_are_minded(tmp_path, size):
    """Open3D and COLMAP write what fits and say nothing; HDF5's library fails when it closes the
    file."""
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(0.02)
    known = RadarCapture(np.ones((1, 1, 94, 94), np.complex64), np.array([77e9]), qar50())
    for name, write in (
        ("a.ply", lambda path: write_mesh(path, sphere)),
        ("a.h5", lambda path: save_capture(path, known)),
        ("sparse", write_cameras),
    ):
        words = f"{name}: cannot be written"
        with files_of_at_most(size), pytest.raises(HandbenchError, match=words):
            write(tmp_path / name)
    assert not list(tmp_path.iterdir())
