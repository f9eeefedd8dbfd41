"""A benchmark small enough to run in seconds: a sphere, three tones, few pixels, no photographs."""

from pathlib import Path

import pytest

from handbench.groundtruth.mesh.surface import load_open3d, write_mesh

SCENE = """
version = 1
name = "ball"
seed = 3
[target]
kind = "mesh"
path = "ball.ply"
distance_m = 0.30
[sensor]
sweep = []
tones_hz = [82e9, 81.8e9, 79.5e9]
"""
BENCH = """
version = 1
name = "small"
seed = 1
repeats = 3
phase_noise_rad = 0.03
[[capture]]
scene = "ball.toml"
[[method]]
id = "2fsk"
precision = true
config = { x = AXIS, y = AXIS }
[[method]]
id = "narrowband"
config = { x = AXIS, y = AXIS, z = { start_m = 0.27, stop_m = 0.29, step_m = 0.002 } }
""".replace("AXIS", "{ start_m = -0.02, stop_m = 0.02, step_m = 0.002 }")


@pytest.fixture
def small_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A benchmark file with the scene and the mesh that it names. Times need not settle
    (test_reconstruct)."""
    monkeypatch.setattr("handbench.bench.stages.reconstruct.REPEATED_S", 0.0)
    return write_bench(tmp_path / "bench")


@pytest.fixture(scope="session")
def small_result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of `small_bench`; a test that changes it copies it."""
    from handbench.bench.benchmarks.benchmark_file import load_benchmark
    from handbench.bench.run.runner import run

    folder = tmp_path_factory.mktemp("small")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("handbench.bench.stages.reconstruct.REPEATED_S", 0.0)
        bench, base = load_benchmark(str(write_bench(folder / "bench")))
        run(bench, base, folder / "out")
    return folder / "out"


def write_bench(folder: Path) -> Path:
    """The same, in a new folder."""
    folder.mkdir()
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(0.02, resolution=40)
    write_mesh(folder / "ball.ply", sphere)
    (folder / "ball.toml").write_text(SCENE)
    (folder / "small.toml").write_text(BENCH)
    return folder / "small.toml"
