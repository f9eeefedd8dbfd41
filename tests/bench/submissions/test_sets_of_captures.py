"""Sets of captures: the hidden part gives nothing of the hands away until its seed is told."""

import hashlib
import json

import numpy as np
import pytest

from bench.cli.main import main
from bench.datasets.dataset import open_capture
from bench.run.benchmark_file import load_benchmark
from bench.scenes.build import build
from bench.scenes.people import MOST_PEOPLE
from bench.submissions import sets
from groundtruth.mesh.mesh_files import read_mesh

SCENE = """
version = 1
name = "F"
seed = 70
effects = ["obliquity", "noise"]
[target]
kind = "hand"
pose = "F"
edge_m = 5e-3
[sensor]
sweep = []
tones_hz = [82e9]
"""
SET = """
version = 1
name = "tiny"
published = 2026-11-23
scenes = ["f.toml"]
distances_m = [0.36]
materials = [{ kind = "plastic" }]
phase_noise_rad = 0.01
people = 2
methods = ["2fsk"]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sets")
    (folder / "f.toml").write_text(SCENE)
    (folder / "tiny.toml").write_text(SET)
    hidden = ["hands", str(folder / "tiny.toml"), "--part", "hidden", "--seed", "20261", "-o", str(folder / "hidden")]
    assert main([*hidden, "--limit", "1"]) == 0
    return folder


def test_the_hidden_part_tells_nothing_but_letter_and_distance(folder):
    hidden = folder / "hidden"
    [at] = (hidden / "captures").iterdir()
    assert at.name == "F-h01-360mm-plastic" and sorted(p.name for p in at.iterdir()) == ["capture.toml", "echoes.h5"]
    text = (at / "capture.toml").read_text()
    number = int(np.random.default_rng(20261).choice(np.arange(1000, MOST_PEOPLE), 2, replace=False)[0])
    assert str(number) not in text and "seed" not in text
    recorded = open_capture(at)
    assert recorded.about.distance_m == 0.36 and recorded.about.seed is None and recorded.truth is None
    assert "20261" not in "".join(p.read_text() for p in hidden.iterdir() if p.is_file())


def test_its_seed_reveals_the_surface_that_was_there_and_another_does_not(folder, capsys):
    hidden = folder / "hidden"
    [at] = (hidden / "captures").iterdir()
    echoes = (at / "echoes.h5").read_bytes()
    reveal = ["hands", str(folder / "tiny.toml"), "--reveal", "--limit", "1", "-o", str(hidden)]
    assert main([*reveal, "--seed", "3"]) == 2 and "is not the one" in capsys.readouterr().err
    assert main(reveal) == 2 and "--seed: is missing" in capsys.readouterr().err
    assert main([*reveal, "--seed", "20261"]) == 0
    assert (at / "echoes.h5").read_bytes() == echoes
    chosen, base = sets.find_set(str(folder / "tiny.toml"))
    number = int(np.random.default_rng(20261).choice(np.arange(1000, MOST_PEOPLE), 2, replace=False)[0])
    scene, _ = next(sets.scenes(chosen, base, {"h01": number}))
    vertices_m = np.asarray(read_mesh(at / "truth.ply").vertices)
    assert np.allclose(vertices_m, np.asarray(build(scene, base).target_mesh.vertices), atol=1e-6)


def test_its_tables_are_right(folder):
    hidden = folder / "hidden"
    for line in (hidden / "checksums.txt").read_text().splitlines():
        digest, name = line.split("  ")
        assert hashlib.sha256((hidden / name).read_bytes()).hexdigest() == digest
    about = json.loads((hidden / "croissant.json").read_text())
    assert {entry["contentUrl"] for entry in about["distribution"]} == {
        str(file.relative_to(hidden)) for file in (hidden / "captures").rglob("*") if file.is_file()
    }
    bench, _ = load_benchmark(str(hidden / "bench.toml"))
    assert [source.path for source in bench.capture] == ["captures/F-h01-360mm-plastic"]


def test_the_embedded_set_is_whole():
    chosen, base = sets.find_set("hands-1")
    people = {f"p{number:02}": number for number in range(1, chosen.people + 1)}
    names = [scene.name for scene, _ in sets.scenes(chosen, base, people)]
    assert len(set(names)) == len(names) == 10 * 3 * 2 * 2


def test_unknown_sets_are_told(tmp_path, capsys):
    assert main(["hands", "hand-1", "-o", str(tmp_path / "s")]) == 2
    assert "did you mean 'hands-1'?" in capsys.readouterr().err
