"""`handbench inspect`: every problem, in the file and on the line where it stands."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.native import CaptureFile, save_capture_file
from handbench.bench.validation.inspection import problems_of, show
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.support.errors import HandbenchError

VERTICES_M = np.array([(0, 0, 0.3), (0.1, 0, 0.4), (0, 0.1, 0.3)])
TONES_HZ = np.array([82e9, 81.8e9, 79.5e9])


def make_capture(
    folder: Path, name="ball", frames=1, scale=1.0, tones_hz=TONES_HZ, **about
) -> Path:
    folder.mkdir(parents=True)
    generator = np.random.default_rng(0)
    array = AntennaArray(*(0.1 * scale * generator.uniform(size=(n, 3)) for n in (3, 4)))
    samples = np.ones((frames, len(tones_hz), 3, 4), np.complex64)
    samples *= np.exp(0.01j * np.arange(len(tones_hz)))[:, None, None]  # equal tones are doubted
    save_capture(folder / "echoes.h5", RadarCapture(samples, tones_hz, array))
    write_mesh(folder / "truth.ply", mesh(scale * VERTICES_M, [(0, 2, 1)]))
    save_capture_file(folder, CaptureFile(name=name, contains=("echoes.h5", "truth.ply"), **about))
    return folder


def found_in(place: Path) -> list[str]:
    """The problems without the folder that they lie in."""
    base = place if place.is_dir() else place.parent
    found = [str(problem) for problem in problems_of(str(place))]
    return [text.replace(f"{base}/", "").replace(str(base), ".") for text in found]


def same(found: list[str], *expected: tuple[str, str]) -> None:
    """One problem for each place and what is written of it, in whatever order, and no other."""
    left = list(found)
    for place, words in expected:
        [match] = [p for p in left if p.startswith(f"{place}: ") and re.search(words, p)]
        left.remove(match)
    assert left == []


def test_every_key_of_a_capture_file_that_is_wrong(tmp_path):
    folder = make_capture(tmp_path / "a")
    (folder / "capture.toml").write_text(
        'version = 2\nname = "a/b"\nkint = "hand"\nunits = "mm"\n'
        'contains = [\n  "photos", 7,\n  "../secret",\n]\n'
        "[methods.2fsk]\nf1_hz = -1.0\nf3_hz = 1e9\n[methods.2fks]\nf1_hz = 1.0\n"
    )
    same(
        found_in(folder),
        ("capture.toml:1", "'version' is 2"),
        ("capture.toml:2", "'a/b'"),
        ("capture.toml:3", "'kint'.*'kind'"),
        ("capture.toml:4", "'units' is 'mm'"),
        ("capture.toml:5", "photos"),
        ("capture.toml:5", r"'contains\.1' is 7"),
        ("capture.toml:5", r"'\.\./secret'"),
        ("capture.toml:10", "'methods.2fsk.f1_hz'"),
        ("capture.toml:11", "'methods.2fsk.f3_hz'"),
        ("capture.toml:12", "'2fks'.*'2fsk'"),
    )


BENCH = """version = 1
name = "b"
sead = 3
[[capture]]
path = "a"
[[capture]]
path = "again"
[[capture]]
path = "../a"
[[capture]]
path = "missing"
[[capture]]
scene = "scene.toml"
[[method]]
id = "3fks"
[[method]]
id = "narrowband"
[method.config]
threshold_db = "low"
"""


def test_every_problem_of_a_benchmark(tmp_path):
    base = tmp_path / "bench"
    for name in ("a", "again"):
        make_capture(base / name)
    (base / "scene.toml").write_text(
        'version = 1\nname = "s"\n[target]\nkind = "mesh"\npath = "x.ply"\nradius_m = 1\n'
    )
    (base / "b.toml").write_text(BENCH)
    same(
        found_in(base / "b.toml"),
        ("b.toml:3", "'sead'.*'seed'"),
        ("b.toml:6", "'ball' in again"),
        ("b.toml:9", r"'\.\./a'"),
        ("b.toml:11", "missing"),
        ("scene.toml:6", "'target.radius_m'"),
        ("b.toml:15", "'3fks'.*'3fsk'"),
        ("b.toml:19", "'method.1.config.threshold_db'"),
    )


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"cameras": [{"name": "a.jpg"}]}, "cameras.0"),
        ({"format": "handbench-array", "tx": {}}, "tx"),
        ({"from": "photo", "to": "radar"}, "matrix"),
        ([1], "expected"),
    ],
    ids=["cameras", "array", "transform", "list"],
)
def test_a_json_file_is_read_as_what_its_keys_say(tmp_path, content, words):
    file = tmp_path / "a.json"
    file.write_text(json.dumps(content))
    [found] = found_in(file)
    assert words in found


def test_every_file_of_a_capture_that_is_wrong(tmp_path):
    folder = make_capture(tmp_path / "a")
    for name in ("echoes.h5", "truth.ply"):
        (folder / name).write_bytes((folder / name).read_bytes()[:-20])
    (folder / "photos").mkdir()
    for name, text in {
        "mesh.ply": "ply\n",
        "array.json": "{}",
        "empty.h5": "",
        "radar_from_photo.json": '{\n "from": "photo",\n "to" "radar"}',
        "target.toml": "version = 1\ncolour = 'white'\n",
        "photos/board.toml": "[[marker]]\nid = 1\n",
        "photos/cameras.json": '{"cameras": [\n{"name": "a.jpg"},\n{"nome": "b.jpg"}\n]}',
    }.items():
        (folder / name).write_text(text)
    found = found_in(folder)
    assert {problem.split(": ")[0] for problem in found} >= {
        *("echoes.h5", "truth.ply", "mesh.ply", "radar_from_photo.json:3", "photos"),
        *("target.toml:2", "photos/board.toml:1", "photos/cameras.json:2"),
    }
    assert any("found only 0 photographs" in problem for problem in found)
    words = "photos/cameras.json:3: unknown key 'cameras.1.nome'; did you mean 'name'"
    assert any(problem.startswith(words) for problem in found)
    shutil.copyfile(make_capture(tmp_path / "b") / "echoes.h5", folder / "echoes.h5")
    places = {problem.split(": ")[0] for problem in found_in(folder)}
    assert places >= {"array.json", "empty.h5"}  # they need the echoes


def test_millimetres_are_suspected(tmp_path):
    box = {"box_m": (-50, -50, 10, 50, 50, 90), "distance_m": 300.0}
    folder = make_capture(tmp_path / "a", scale=1e3, tones_hz=TONES_HZ / 1e9, **box)
    matrix = np.eye(4)
    matrix[:3, 3] = (4.0, -6.0, 400.0)
    Transform("photo", "radar", matrix).save(folder / "radar_from_photo.json")
    found = found_in(folder)
    assert len(found) == 6 and all(": warning: " in problem for problem in found)
    of_facts = "distance_m is 300", "box_m reaches 90", "moves points by 400 m"
    for words in (*of_facts, "an antenna is", "gigahertz", "is 100 m long"):
        assert sum(words in problem for problem in found) == 1


def test_tones_that_a_scene_lacks_are_named_where_it_is(tmp_path):
    scene = 'name = "s"\n[target]\nkind = "sphere"\n[sensor]\nsweep = []\ntones_hz = [82e9, 81.8e9]'
    (tmp_path / "s.toml").write_text(f"version = 1\n{scene}\n")
    (tmp_path / "b.toml").write_text(
        'version = 1\nname = "b"\n[[capture]]\nscene = "s.toml"\n[[method]]\nid = "3fsk"\n'
    )
    same(found_in(tmp_path / "b.toml"), ("b.toml:3", "'s' with method '3fsk'.* 79.5000 GHz"))


def test_the_command_counts_and_fails_and_says_what_is_fine(tmp_path, small_bench, capsys):
    fine = make_capture(tmp_path / "fine")
    show(
        [
            str(fine),
            str(small_bench),
            str(small_bench.parent / "ball.toml"),
            "paper_table",
            "moving_hands",
        ]
    )
    assert capsys.readouterr().out.count(": no problem found\n") == 5
    for number in range(6):
        folder = make_capture(tmp_path / "data" / f"c{number}", name=f"c{number // 2}")
        if number % 5 == 0:
            (folder / "truth.ply").write_bytes(b"")
    with pytest.raises(HandbenchError, match="inspect: 2 problems, 3 warnings, 1 input"):
        show([str(tmp_path / "data")])
    out = capsys.readouterr().out
    assert out.count("\n") == 5 and out.count("a benchmark needs different names") == 3
