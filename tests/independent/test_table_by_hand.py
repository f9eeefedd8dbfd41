"""The paper's block of a small result, from maps and from echoes, by code that shares nothing with
handbench."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.run.runner import run
from handbench.groundtruth.mesh.surface import load_open3d, write_mesh
from tests.independent import table_by_hand
from tests.small_benchmark import BENCH, SCENE

AXIS = "{ start_m = -0.02, stop_m = 0.02, step_m = 0.002 }"
DEPTHS = "{ start_m = 0.27, stop_m = 0.3, step_m = 0.002 }"
TONES = "{ start_hz = 79.5e9, stop_hz = 82e9, count = 11 }"
FURTHER = f"""
[[method]]
id = "3fsk"
precision = true
config = {{ x = {AXIS}, y = {AXIS} }}
[[method]]
id = "broadband"
config = {{ x = {AXIS}, y = {AXIS}, z = {DEPTHS}, tones_hz = {TONES} }}
"""
SWEEP = f"sweep = [{TONES}]"


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small benchmark's result, with all four methods of the paper."""
    folder = tmp_path_factory.mktemp("by_hand")
    write_mesh(
        folder / "ball.ply", load_open3d().geometry.TriangleMesh.create_sphere(0.02, resolution=40)
    )
    scene = SCENE.replace("sweep = []", SWEEP).replace("82e9, 81.8e9, 79.5e9]", "81.8e9]")
    (folder / "ball.toml").write_text(scene)
    (folder / "small.toml").write_text(BENCH + FURTHER)
    bench, base = load_benchmark(str(folder / "small.toml"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("handbench.bench.stages.reconstruct.REPEATED_S", 0.0)
        run(bench, base, folder / "out")
    return folder / "out"


def test_the_table_follows_from_the_maps(result):
    ours, theirs = table_by_hand.figures(result), table_by_hand.table(result)
    assert len(ours) == 10 and ours.keys() == theirs.keys()
    assert ours == pytest.approx(theirs, rel=table_by_hand.TABLE_RTOL)
    assert table_by_hand.main([str(result)]) == 0


def test_a_changed_depth_is_found(result, tmp_path):
    shutil.copytree(result, tmp_path / "spoilt", ignore=shutil.ignore_patterns("work"))
    path = tmp_path / "spoilt" / "depth" / "ball__3fsk.npz"
    with np.load(path) as kept:
        content = dict(kept)
    row, column = np.argwhere(np.isfinite(content["z_m"]))[0]
    content["z_m"][row, column] += 1e-9
    np.savez(path, **content)
    assert table_by_hand.main([str(tmp_path / "spoilt")]) == 1


def test_the_depths_follow_from_the_echoes(result):
    [echoes] = result.glob("work/simulate-ball-*/capture/echoes.h5")
    found = list(table_by_hand.depths_by_hand(result, "ball", echoes))
    assert [facts["method"] for facts in found] == list(table_by_hand.METHODS)
    for facts in found:
        assert facts["pixels"] > 10 and table_by_hand.within(facts), facts
    strongest = table_by_hand.strongest_by_hand(result, "ball", "ball", echoes)
    for method, (off_m, precision_mm) in strongest.items():
        assert off_m <= table_by_hand.FSK_BOUND_M[method]
        kept = table_by_hand.table(result)["precision_mm", method, "truth"]
        assert precision_mm == pytest.approx(kept, abs=2e3 * table_by_hand.FSK_BOUND_M[method])


def test_another_sign_or_correction_is_found(result, tmp_path):
    [echoes] = result.glob("work/simulate-ball-*/capture/echoes.h5")
    shutil.copy(echoes, tmp_path / "echoes.h5")
    with h5py.File(tmp_path / "echoes.h5", "r+") as kept:
        kept["samples"][...] = kept["samples"][...].conj()
    found = table_by_hand.depths_by_hand(result, "ball", tmp_path / "echoes.h5")
    assert not any(table_by_hand.within(facts) for facts in found)
