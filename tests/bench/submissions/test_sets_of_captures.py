"""Sets of captures: what they hold, how they grow, and what is refused before hours are spent."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.scenes.build import build
from handbench.bench.submissions import sets
from handbench.cli.main import main
from handbench.groundtruth.mesh.mesh_files import read_mesh

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


SHARED = ("bench.toml", "checksums.txt", "croissant.json")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sets")
    (folder / "f.toml").write_text(SCENE)
    (folder / "tiny.toml").write_text(SET)
    assert main(["hands", str(folder / "tiny.toml"), "-o", str(folder / "set"), "--limit", "1"]) == 0
    return folder


def test_a_capture_is_the_persons_hand_as_the_set_says(folder):
    chosen, base = sets.find_set(str(folder / "tiny.toml"))
    (scene, distance_m), (other, _) = sets.scenes(chosen, base)
    assert (scene.name, other.name) == ("F-p01-360mm-plastic", "F-p02-360mm-plastic")
    recorded = open_capture(folder / "set" / "captures" / scene.name)
    assert recorded.about.distance_m == distance_m == 0.36 and scene.target.person == 1
    vertices_m = np.asarray(read_mesh(recorded.truth).vertices)
    assert np.allclose(vertices_m, np.asarray(build(scene, base).target_mesh.vertices), atol=1e-6)
    z = recorded.about.methods["broadband"]["z"]
    assert z["start_m"] < vertices_m[:, 2].min() and z["stop_m"] > vertices_m[:, 2].min() + 0.03  # fingers and palm


def test_a_set_grows_and_keeps_what_is_there(folder, tmp_path, capsys):
    [at] = (folder / "set" / "captures").iterdir()
    before = (at / "echoes.h5").stat().st_mtime_ns
    command = ["hands", str(folder / "tiny.toml"), "-o", str(folder / "set"), "--limit"]
    assert main([*command, "2"]) == 0 and main([*command, "1"]) == 0
    assert (at / "echoes.h5").stat().st_mtime_ns == before
    bench, _ = load_benchmark(str(folder / "set" / "bench.toml"))
    assert len(bench.capture) == 2  # not cut to the one that was asked for last
    (folder / "other.toml").write_text(SET.replace("tiny", "other"))
    assert main(["hands", str(folder / "other.toml"), "-o", str(folder / "set")]) == 2
    assert "holds another set than other" in capsys.readouterr().err


def made(folder, *options):
    """A hidden part of one capture: its folder, what `handbench hands` ends with, and its echoes."""
    ended = main(["hands", str(folder.parent / "tiny.toml"), "-o", str(folder), "--limit", "1", *options])
    echoes = [file.read_bytes() for file in folder.glob("captures/*/echoes.h5")]
    return ended, echoes


@pytest.fixture
def hidden(folder, tmp_path):
    for name in ("f.toml", "tiny.toml"):
        (tmp_path / name).write_text((folder / name).read_text())
    assert made(tmp_path / "part", "--hidden", str(tmp_path / "secret"))[0] == 0
    return tmp_path / "part", tmp_path / "secret"


def test_a_hidden_part_tells_nothing_of_its_people_and_gets_its_surfaces_later(folder, hidden):
    part, secret = hidden
    assert secret.stat().st_mode & 0o077 == 0 and len(bytes.fromhex(secret.read_text())) == 16
    held = [file for file in part.rglob("*") if file.is_file()]
    assert {file.name for file in held} == {*SHARED, "capture.toml", "echoes.h5"}
    for file in held:
        content = file.read_bytes()
        assert secret.read_bytes().strip() not in content and b"seed" not in content and b"person" not in content
    _, [before] = made(part, "--hidden", str(secret))
    assert made(part, "--hidden", str(secret), "--truth") == (0, [before])
    [truth] = part.glob("captures/*/truth.ply")
    public = next((folder / "set").glob("captures/*/truth.ply"))
    assert "truth.ply" in open_capture(truth.parent).about.contains
    assert "truth.ply" in (part / "checksums.txt").read_text()
    assert np.abs(np.asarray(read_mesh(truth).vertices)[:50] - np.asarray(read_mesh(public).vertices)[:50]).max() > 1e-3


def test_a_secret_alone_makes_a_hidden_part_again(hidden, tmp_path):
    """The same echoes by the same secret, others by another: nothing else draws people and noise."""
    part, secret = hidden
    _, first = made(part, "--hidden", str(secret))
    _, again = made(tmp_path / "again", "--hidden", str(secret))
    _, other = made(tmp_path / "other", "--hidden", str(tmp_path / "other secret"))
    assert first == again != other


def test_numbers_of_people_are_too_many_to_be_tried(hidden):
    chosen, base = sets.find_set(str(hidden[0].parent / "tiny.toml"))
    drawn = {n for s, _ in sets.scenes(chosen, base, hidden[1].read_text().strip()) for n in (s.seed, s.target.person)}
    assert len(drawn) == 4 and min(drawn) > 2**100  # of 128 bits: smaller once in 10⁸


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--truth"], "name its secret"),
        (["--hidden", "no file", "--truth"], "no file"),
        (["--hidden", "tiny.toml", "--truth"], "tiny.toml"),
        (["--hidden", "part"], "part"),
        (["--hidden", "another"], "holds another set than tiny-hidden-"),
        (["--hidden", "new"], "new"),
        (["--hidden", "part/secret"], "put the secret elsewhere"),
    ],
)
def test_a_wrong_secret_is_told(hidden, monkeypatch, capsys, options, words):
    part, _ = hidden
    monkeypatch.chdir(part.parent)
    (part.parent / "another").write_text("0" * 32)
    kept = sorted((file, file.read_bytes()) for file in part.rglob("*") if file.is_file())
    assert made(part, *options)[0] == 2
    assert words in capsys.readouterr().err and not Path("new").exists()
    assert kept == sorted((file, file.read_bytes()) for file in part.rglob("*") if file.is_file())


def test_a_hidden_part_that_was_interrupted_goes_on_with_its_secret_alone(hidden, tmp_path, capsys):
    part, secret = hidden
    (part / "bench.toml").write_text("\n".join((part / "bench.toml").read_text().splitlines()[:2]))  # as it begins
    (tmp_path / "other").write_text("0" * 32)
    assert made(part, "--hidden", str(tmp_path / "other"))[0] == 2
    assert "holds another set" in capsys.readouterr().err
    assert made(part, "--hidden", str(secret))[0] == 0


def test_surfaces_of_other_hands_are_not_added(hidden, capsys):
    part, secret = hidden
    scene = part.parent / "f.toml"
    scene.write_text(scene.read_text().replace('pose = "F"', 'pose = "F"\noffset_m = [0.0, 5e-3]'))
    assert made(part, "--hidden", str(secret), "--truth")[0] == 2
    assert "its echoes differ" in capsys.readouterr().err and not list(part.glob("captures/*/truth.ply"))


WRONG = {
    "two of a name": (
        "materials = [{ kind",
        'materials = [{ kind = "plastic", permittivity = 4.0 }, { kind',
        "two captures",
    ),
    "no method": ('"2fsk"', '"2fks"', "did you mean '2fsk'?"),
    "outside": ('"f.toml"', '"../f.toml"', "leaves the folder"),
}


@pytest.mark.parametrize(("old", "new", "words"), WRONG.values(), ids=WRONG)
def test_a_wrong_set_is_refused_before_anything_is_simulated(folder, tmp_path, capsys, old, new, words):
    (tmp_path / "f.toml").write_text(SCENE)
    (tmp_path / "tiny.toml").write_text(SET.replace(old, new))
    assert main(["hands", str(tmp_path / "tiny.toml"), "-o", str(tmp_path / "set")]) == 2
    assert words in capsys.readouterr().err and not (tmp_path / "set").exists()


def test_its_tables_are_right(folder):
    made = folder / "set"
    for line in (made / "checksums.txt").read_text().splitlines():
        digest, name = line.split("  ")
        assert hashlib.sha256((made / name).read_bytes()).hexdigest() == digest
    about = json.loads((made / "croissant.json").read_text())
    assert {entry["contentUrl"] for entry in about["distribution"]} == {
        str(file.relative_to(made)) for file in (made / "captures").rglob("*") if file.is_file()
    }


def test_the_embedded_set_is_whole():
    chosen, base = sets.find_set("hands-1")
    names = [scene.name for scene, _ in sets.scenes(chosen, base)]
    assert len(set(names)) == len(names) == 10 * 3 * 2 * 2


def test_unknown_sets_are_told(tmp_path, capsys):
    assert main(["hands", "hand-1", "-o", str(tmp_path / "s")]) == 2
    assert "did you mean 'hands-1'?" in capsys.readouterr().err
