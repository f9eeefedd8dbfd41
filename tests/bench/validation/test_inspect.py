"""`handbench inspect` reads an input as a run does, and names the place of every problem."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from handbench.bench.datasets.native import CaptureFile, save_capture_file
from handbench.bench.datasets.simulated import write_photos
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.validation.inspection import inspect, show
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.support.config import parse
from handbench.support.errors import HandbenchError

VERTICES_M = np.array([(0, 0, 0.3), (0.1, 0, 0.4), (0, 0.1, 0.3)])
TONES_HZ = np.array([82e9, 81.8e9, 79.5e9])
Change = Callable[[Path], object]  # of a capture's folder


def make_capture(folder: Path, name: str = "ball") -> Path:
    folder.mkdir(parents=True)
    generator = np.random.default_rng(0)
    array = AntennaArray(*(0.1 * generator.uniform(size=(n, 3)) for n in (3, 4)))
    samples = np.ones((1, 3, 3, 4), np.complex64)
    samples *= np.exp(0.01j * np.arange(3))[:, None, None]  # equal tones would be copies
    save_capture(folder / "echoes.h5", RadarCapture(samples, TONES_HZ, array))
    write_mesh(folder / "truth.ply", mesh(VERTICES_M, [(0, 2, 1)]))
    save_capture_file(folder, CaptureFile(name=name, contains=("echoes.h5", "truth.ply")))
    return folder


def found_in(place: Path) -> list[str]:
    """The lines of the report, without the folder of the input."""
    base = place if place.is_dir() else place.parent
    return [
        text.replace(f"{base}/", "").replace(str(base), ".") for text in inspect(str(place)).lines
    ]


def same(found: list[str], *expected: str) -> None:
    """One line for each pattern, in whatever order, and no other."""
    left = list(found)
    for pattern in expected:
        [match] = [line for line in left if re.match(pattern, line)]
        left.remove(match)
    assert left == []


def text_of(name: str, text: str) -> Change:
    def write(folder: Path) -> None:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)

    return write


def described(text: str) -> Change:
    return text_of("capture.toml", f'version = 1\nname = "ball"\n{text}')


def cut(name: str) -> Change:
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:-20])


def carried(matrix: np.ndarray) -> Change:
    def save(folder: Path) -> None:
        write_mesh(folder / "mesh.ply", mesh(VERTICES_M, [(0, 2, 1)]))
        Transform("photo", "radar", matrix).save(folder / "radar_from_photo.json")

    return save


BEHIND = np.diag([1.0, -1, -1, 1])
FAR = np.array([[1, 0, 0, 4.0], [0, 1, 0, -6], [0, 0, 1, 400], [0, 0, 0, 1]])
CAPTURES: dict[str, tuple[Change, tuple[str, ...]]] = {
    "keys": (
        described('kint = "hand"\nunits = "mm"'),
        ("capture.toml: unknown key 'kint'.*'kind'", "capture.toml: 'units' is 'mm'"),
    ),
    "method's keys": (
        described("[methods.2fsk]\ntolerance = 1.0\nf3_hz = 1e9"),
        ("capture.toml: .*2fsk.*'tolerance' is 1.0", "capture.toml: .*2fsk.*unknown key 'f3_hz'"),
    ),
    "method": (described("[methods.2fks]\ntolerance = 1e-3"), ("capture.toml: .*'2fks'.*'2fsk'",)),
    "contains": (described('contains = ["photos", "no"]'), (".: photos is mis", ".: no is mis")),
    "outside": (described('contains = ["../secret"]'), (r".: .*'\.\./secret'",)),
    "box": (described("box_m = [1, 1, 1, 0, 0, 0]"), ("capture.toml: 'box_m' is",)),
    "box in mm": (described("box_m = [-50, -50, 10, 50, 50, 90]"), ("capture.toml: warning: ",)),
    "target": (described('kind = "target"'), (".: .*without target.toml",)),
    "no echoes": (
        lambda folder: (folder / "echoes.h5").unlink(),
        ("echoes.h5: .*no such file",) * 2,
    ),
    "echoes": (cut("echoes.h5"), ("echoes.h5: ",)),
    "truth": (cut("truth.ply"), ("truth.ply: ",)),
    "mesh": (text_of("mesh.ply", "ply\n"), ("mesh.ply: ",)),
    "array": (text_of("array.json", "{}"), ("array.json: .*'source'", *["array.json: "] * 5)),
    "transform": (
        text_of("radar_from_photo.json", '{"from": 1,\n "to" 2}'),
        ("radar_from_.*line 2",),
    ),
    "millimetres": (carried(FAR), ("radar_from_photo.json: warning: it moves points by 400 m",)),
    "behind": (carried(BEHIND), ("radar_from_photo.json: warning: .*inverse transform",)),
    "photos": (
        text_of("photos/board.toml", "[[marker]]\nid = 1\n"),
        ("photos: .*only 0", "photos/board.toml: "),
    ),
    "cameras": (
        text_of("photos/cameras.json", '{"cameras": [{"nome": "b.jpg"}]}'),
        ("photos: .*only 0", "photos/cameras.json: unknown key 'cameras.0.nome'"),
    ),
}


@pytest.mark.parametrize(("change", "places"), CAPTURES.values(), ids=CAPTURES)
def test_a_problem_of_a_capture_is_named_with_its_file(tmp_path, change, places):
    change(folder := make_capture(tmp_path / "a"))
    found = found_in(folder)
    assert all(any(re.match(place, line) for line in found) for place in places), found


BENCHES = {
    "keys": ('sead = 3\n[[capture]]\npath = "a"', "", ("b.toml: unknown key 'sead'.*'seed'",)),
    "captures": (
        "".join(f'[[capture]]\npath = "{path}"\n' for path in ("a", "again", "../a", "missing")),
        "",
        ("b.toml: .*two captures are named 'ball'|b.toml: two.*'ball'", r".*'\.\./a'", "missing: "),
    ),
    "scene": ('[[capture]]\nscene = "scene.toml"', "", ("scene.toml: .*'target.edge'",)),
    "methods": (
        '[[capture]]\npath = "a"',
        '[[method]]\nid = "3fks"\n[[method]]\nid = "narrowband"\nconfig = {drop = 1, thin = 2}\n',
        ("b.toml: .*'3fks'.*'3fsk'", "b.toml: .*'narrowband'.*'drop'", "b.toml: .*'thin'"),
    ),
    "tones": (
        '[[capture]]\nscene = "two.toml"\n[[capture]]\npath = "a"',
        '[[method]]\nid = "3fsk"\n[[method]]\nid = "2fsk"\nconfig = {tones_hz = [60e9, 60.2e9]}\n',
        (
            "b.toml: capture 's' with method '3fsk': .*79.5000 GHz",
            *(f"b.toml: capture '{name}' with method '2fsk': .*60.0" for name in ("s", "ball")),
        ),
    ),
    "frames": (
        '[[capture]]\npath = "a"',
        '[[method]]\nid = "2fsk"\nprecision = true\n',
        ("b.toml: capture 'ball' with method '2fsk': frame 9",),
    ),
    "maps": (
        '[[capture]]\npath = "a"',
        '[[method]]\nid = "mine"\nmaps = "again"\n',
        ("b.toml: capture 'ball' with method 'mine': .*ball.npz",),
    ),
    "calibration": (
        '[[capture]]\npath = "a"\n[calibration]\npath = "a"',
        "",
        ("b.toml: .*calibration.*target.toml, photos",),
    ),
}


@pytest.mark.parametrize(("captures", "methods", "places"), BENCHES.values(), ids=BENCHES)
def test_every_problem_of_a_benchmark(tmp_path, captures, methods, places):
    base = tmp_path / "bench"
    for name in ("a", "again"):
        make_capture(base / name)
    scene = 'version = 1\nname = "s"\n[target]\nkind = "sphere"\n'
    (base / "scene.toml").write_text(f"{scene}edge = 1")
    (base / "two.toml").write_text(f"{scene}[sensor]\nsweep = []\ntones_hz = [82e9, 81.8e9]\n")
    methods = methods or '[[method]]\nid = "2fsk"\n'
    (base / "b.toml").write_text(f'version = 1\nname = "b"\n{captures}\n{methods}')
    same(found_in(base / "b.toml"), *places)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.json", json.dumps({"cameras": [{"name": "a.jpg"}]}), "cameras.0"),
        ("a.json", json.dumps({"format": "handbench-array", "tx": {}}), "tx"),
        ("a.json", json.dumps({"from": "photo", "to": "radar"}), "matrix"),
        ("a.json", "[1]", "[1]"),
        ("a.toml", "version =\n", "line 1"),
        ("a.toml", "[[element]]\ncentre_m = 3", "element.0"),
        ("a.npz", "PK", "npz"),
    ],
)
def test_a_file_is_read_as_what_its_name_and_its_keys_say(tmp_path, name, content, words):
    (tmp_path / name).write_text(content)
    found = found_in(tmp_path / name)
    assert found and any(words in line for line in found)


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        (np.s_[:], ()),
        (np.s_[:, ::-1], (r"a.ply: warning: .*inside out",)),
        (np.s_[:2], (r"a.ply: warning: .*only one triangle",)),
    ],
)
def test_a_mesh_inside_out_or_full_of_holes_is_warned_of(tmp_path, kept, words):
    corners_m = 0.1 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    outside = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    write_mesh(tmp_path / "a.ply", mesh(corners_m, outside[kept]))
    same(found_in(tmp_path / "a.ply"), *words)


def test_photographs_are_compared_with_their_cameras_and_their_board(tmp_path):
    photos = {"cameras": 3, "width": 900, "height": 600}
    scene = {"version": 1, "name": "ball", "target": {"kind": "sphere"}, "photos": photos}
    write_photos(build(parse(SceneFile, scene, "the ball")), tmp_path)
    folder = tmp_path / "photos"
    (folder / "truth_cameras.json").unlink()
    assert found_in(folder) == []
    file, board = folder / "cameras.json", folder / "board.toml"
    right = file.read_text()
    turned = {"width": "height", "height": "width"}
    file.write_text(re.sub("width|height", lambda name: turned[name[0]], right))
    same(found_in(folder), "cameras.json: .*is for 600 × 900 pixels")
    file.write_text(right)
    content = tomllib.loads(board.read_text())
    for marker in content["marker"]:
        marker["corners_m"] = (10 * np.array(marker["corners_m"])).tolist()
    board.write_text(tomlkit.dumps(content))
    same(found_in(folder), "board.toml: warning: .*m from the board")


def test_the_command_counts_and_fails_and_wraps_on_a_terminal(
    tmp_path, small_bench, capsys, monkeypatch
):
    scene = small_bench.parent / "ball.toml"
    show([str(small_bench), str(scene), "paper_table", "moving_hands"])
    assert capsys.readouterr().out.count(": no problem found\n") == 4
    for number in range(6):
        folder = make_capture(tmp_path / "data" / f"c{number}", name=f"c{number // 2}")
        if number % 5 == 0:
            (folder / "truth.ply").write_bytes(b"")
    with pytest.raises(HandbenchError, match="inspect: 2 problems, 3 warnings, 1 input"):
        show([str(tmp_path / "data")])
    assert capsys.readouterr().out.count("\n") == 5
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(HandbenchError):
        show(["data"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 5 and max(map(len, lines)) <= 80
