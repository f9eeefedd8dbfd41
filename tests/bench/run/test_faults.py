"""Faults around a run: each is said in one line, nothing half-made is taken for whole, and a
resumed run ends where an undisturbed one does.

Elsewhere: kill −9 (test_runner), two runs in one folder (test_runner), lost workers
(test_schedule), limits of volumes (test_imaging).
"""

import ast
import shutil
import subprocess
import sys
import time
import tracemalloc
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import psutil
import pytest

from handbench.bench import results
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.runner import run
from handbench.bench.run.write_result import tabulate
from handbench.groundtruth.cameras.camera_files import write_model
from handbench.groundtruth.dense.planesweep import swept_disparity
from handbench.groundtruth.dense.views import Stereo
from handbench.groundtruth.mesh.mesh_files import load_open3d, write_mesh
from handbench.radar.data.arrays import PlanarScan, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, write_json
from handbench.support.folder import claimed
from handbench.support.store import MANIFEST, Stage, cached
from tests.bench.run.faults import DISK, content, instant, nobody_s_rights
from tests.bench.run.jobs_of_tests import few_bytes, some_time, two_files
from tests.faults.disk import files_of_at_most
from tests.fuzz.geometry_seeds import colmap_model
from tests.installed_copy import ROOMS

ROOT = Path(__file__).parents[3]


def execute(bench_file: Path, folder: Path) -> results.Result:
    bench, base = load_benchmark(str(bench_file))
    return run(bench, base, folder)


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


@pytest.mark.parametrize(("rename", "step"), [(False, 5), (True, 3)], ids=["files", "renames"])
def test_a_disk_full_at_any_write_leaves_nothing_half_made(
    small_bench, clean, tmp_path, rename, step
):
    """At the first write, and so on by steps, until none is left to fail."""
    expected, at, said = content(clean), 1 - step, "…"
    while said:
        at, said = at + step, ""
        out = tmp_path / f"full{at}"
        with DISK.full(out, at, rename):
            try:  # what one stage could not write is recorded, where others could
                said = "".join(
                    failure.message for failure in execute(small_bench, out).about.failures
                )
            except HandbenchError as error:
                said = str(error)
                assert not (out / "result.json").exists()
        if said:
            assert "No space left" in said and "\n" not in said
            execute(small_bench, out)
        assert content(out) == expected
        shutil.rmtree(out)
    assert at > (15 if rename else 30)  # the run has that many


def test_a_file_size_limit_of_the_system_is_a_full_disk_too(small_bench, tmp_path):
    """Here the libraries that write by themselves meet it: HDF5, meshes, pictures."""
    limited = (
        "import resource, sys; from handbench.cli.main import main; "
        "resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000)); "
        "sys.exit(main())"
    )
    command = [sys.executable, "-c", limited, "run", str(small_bench), "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert (
        done.returncode == 2
        and "Traceback" not in done.stderr
        and "cannot be written" in done.stderr
    )
    assert not (tmp_path / "out" / "result.json").exists() and not list(
        (tmp_path / "out" / "work").iterdir()
    )


def test_a_folder_that_is_read_only_is_one_line(small_bench, clean, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    out.chmod(0o555)
    with nobody_s_rights():
        with pytest.raises(HandbenchError, match=r"out: cannot be written \(Permission denied\)"):
            execute(small_bench, out)
        with pytest.raises(
            HandbenchError, match=r"out/a\.json: cannot be written \(Permission denied\)"
        ):
            write_json(out / "a.json", {})
    assert not list(out.iterdir())
    out.chmod(0o755)
    execute(small_bench, out)
    (out / "work").chmod(0o555)
    for file in (out / "work").iterdir():
        file.chmod(0o555)
    with nobody_s_rights():
        again = execute(small_bench, out)  # nothing is left to be made there
    assert again.tasks.cached.all() and content(out) == content(clean)


def test_a_flipped_bit_in_any_kept_file_is_found_said_and_made_again(
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
        made = execute(small_bench, out).tasks.query("not cached").task.tolist()
        stage = file.relative_to(out / "work").parts[0]
        assert len(made) == 1 and stage.startswith(made[0])
        [said] = [
            line for line in capsys.readouterr().err.splitlines() if "it is made again" in line
        ]
        assert stage in said and (
            file.name in said or file.name == MANIFEST
        )  # which names what it cannot find
        assert content(out) == expected


def test_every_single_bit_counts(tmp_path):
    one = Stage("one", few_bytes, {}, [])
    cached(tmp_path, one)
    kept = one.folder(tmp_path)
    for name in ("a", MANIFEST):
        whole = (kept / name).read_bytes()
        for bit in range(8 * len(whole)):
            broken = bytearray(whole)
            broken[bit // 8] ^= 1 << bit % 8
            (kept / name).write_bytes(broken)
            assert not cached(tmp_path, one)[1]
            if (
                name != MANIFEST
            ):  # which has the size of the stamp, and that the time that was taken
                assert (kept / name).read_bytes() == whole


def test_a_kept_file_that_is_gone_is_missed_and_a_new_one_is_not(tmp_path, capsys):
    two = Stage("two", two_files, {}, [])
    cached(tmp_path, two)
    kept = two.folder(tmp_path)
    (kept / ".DS_Store").write_text("a file browser was here")
    assert cached(tmp_path, two)[1]
    (kept / "sub" / "a").unlink()
    (kept / "b").unlink()
    assert not cached(tmp_path, two)[1]
    assert "b and 1 more differs" in capsys.readouterr().err and cached(tmp_path, two)[1]


def test_a_clock_that_jumps_changes_nothing(small_bench, clean, tmp_path, monkeypatch):
    """Backwards, and years ahead: what is kept stays so, and nothing has taken less than no
    time."""
    expected, now = content(clean), time.time()
    for jump_s in (-3e8, 3e9):
        monkeypatch.setattr(time, "time", lambda jump_s=jump_s: now + jump_s)
        result = execute(small_bench, clean)
        assert result.tasks.cached.all() and content(clean) == expected
        stamp, there = cached(tmp_path, Stage("new", some_time, {}, [jump_s]))
        assert not there and 0 < stamp.seconds < 1e7  # neither jump counts


WALL_CLOCKS = {
    ("time", "time"),
    ("time", "time_ns"),
    ("datetime", "now"),
    ("datetime", "utcnow"),
    ("date", "today"),
}


def test_no_duration_and_no_decision_comes_from_the_wall_clock():
    """It jumps; monotonic clocks do not. Nor does anything ask when a file was changed."""
    found = []
    for package in (*ROOMS, "handbench"):
        for file in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Attribute):
                    owner = (
                        node.value.attr
                        if isinstance(node.value, ast.Attribute)
                        else getattr(node.value, "id", "")
                    )
                    if (owner, node.attr) in WALL_CLOCKS or node.attr in (
                        "st_mtime",
                        "st_mtime_ns",
                        "getmtime",
                    ):
                        found.append(f"{file.relative_to(ROOT)}:{node.lineno}: {owner}.{node.attr}")
    assert found == []


def test_two_runs_at_once_exclude_each_other_as_processes(tmp_path):
    """The lock is the system's: it holds between processes, and falls with the one that holds
    it."""
    hold = (
        "import sys; from pathlib import Path; from handbench.support.folder import claimed\n"
        "with claimed(Path(sys.argv[1])):\n    print('held', flush=True)\n    sys.stdin.read()"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", hold, str(tmp_path / "out")], stdin=-1, stdout=-1, cwd=ROOT
    )
    assert holder.stdout.readline() == b"held\n"
    with (
        pytest.raises(HandbenchError, match="another run is writing here"),
        claimed(tmp_path / "out"),
    ):
        pass
    holder.kill()
    holder.communicate()
    with claimed(tmp_path / "out") as work:
        assert work.is_dir()


Free = namedtuple("Free", "available total")


@pytest.fixture
def small_machine(monkeypatch):
    """A machine with 10 MB of memory, 1 MB of it free."""
    monkeypatch.delenv("HANDBENCH_MEMORY_GB", raising=False)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: Free(1e6, 1e7))


def refused(work, match: str) -> None:
    """It is refused in words with its size, and next to nothing was taken before."""
    tracemalloc.start()
    try:
        with pytest.raises(HandbenchError, match=match):
            work()
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_a_volume_beyond_memory_is_refused_before_it_is_made(small_machine):
    axis_m = np.linspace(-0.1, 0.1, 100)
    samples, grid = np.ones((1, 94, 94), np.complex64), VoxelGrid(axis_m, axis_m, axis_m + 0.3)
    for tolerance in (None, 1e-3):
        refused(
            lambda tolerance=tolerance: image_volume(
                samples, np.array([77e9]), qar50(), grid, tolerance
            ),
            r"volume of 1 × \(100, 100, 100\) voxels .* needs 0\.008 GB, more than the limit of "
            r"0\.0025 GB",
        )


def test_echoes_beyond_memory_are_refused_before_they_are_read(small_machine, tmp_path):
    samples, scan = np.ones((1, 2, 100_000), np.complex64), PlanarScan(np.zeros((100_000, 3)))
    save_capture(tmp_path / "echoes.h5", RadarCapture(samples, np.array([1e9, 2e9]), scan))
    refused(
        lambda: load_capture(tmp_path / "echoes.h5"),
        r"echoes\.h5: 'samples' \(1, 2, 100000\): needs 0\.0032 GB, and 0\.001 GB of memory are "
        r"free",
    )


def test_echoes_that_a_file_does_not_hold_are_refused(tmp_path):
    """Sixteen terabytes, packed so well that the file has none of them."""
    with h5py.File(tmp_path / "echoes.h5", "w") as file:
        file.attrs["format"], file.attrs["version"] = "handbench-echoes", 1
        file.create_dataset(
            "samples", (1, 2, 10**12), np.complex64, chunks=(1, 1, 2**20), compression="gzip"
        )
    refused(
        lambda: load_capture(tmp_path / "echoes.h5"),
        "16000000000000 bytes, of which the file holds 0",
    )


def test_a_plane_sweep_beyond_memory_is_refused_before_it_is_made(small_machine):
    picture = np.zeros((60, 80), np.float32)
    one = Stereo(
        picture, picture[None], np.array([[60, 80]]), np.eye(3)[None], np.zeros((1, 3)), unit=1.0
    )
    refused(
        lambda: swept_disparity(one, 0.0, 256),
        r"dense: 256 planes of 80 × 60 pixels: needs 0\.00492 GB, and 0\.001 GB of memory are "
        r"free; choose a lower",
    )


def write_folder(path: Path, write: Callable[[Path], None]) -> None:
    with atomic_folder(path) as folder:
        write(folder)


def test_libraries_that_do_not_mind_a_full_disk_are_minded(tmp_path):
    """Open3D and COLMAP write what fits and say nothing; HDF5's library fails when it closes the
    file."""
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(0.02)
    model = colmap_model()
    echoes = RadarCapture(np.ones((1, 1, 94, 94), np.complex64), np.array([77e9]), qar50())
    for size in (100, 1000, 6000):
        for name, write in (
            ("a.ply", lambda path: write_mesh(path, sphere)),
            ("a.h5", lambda path: save_capture(path, echoes)),
            ("sparse", lambda path: write_folder(path, lambda folder: write_model(model, folder))),
        ):
            if (name, size) == ("sparse", 6000):  # fits
                continue
            with (
                files_of_at_most(size),
                pytest.raises(HandbenchError, match=f"{name}: cannot be written"),
            ):
                write(tmp_path / name)
            assert not (tmp_path / name).exists() and not list(tmp_path.glob(".*"))
