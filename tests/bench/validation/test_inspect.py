"""`handbench inspect` reads an input as a run does, and names the place of every problem."""

from __future__ import annotations

import json
import re
import shutil
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
from handbench.groundtruth.mesh.surface import mesh, write_mesh
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture, thin_antennas
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.support.config import parse
from tests.golden_files import GOLDEN
from tests.refusals import refuse

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


def named(place: Path, *places: str) -> list[str]:
    """The lines of the report, in which every one of the places, words apart, is in one line."""
    lines = list(inspect(str(place)).lines)
    for words in filter(None, places):
        assert any(all(word in line for word in words.split()) for line in lines), (words, lines)
    return lines


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
        ("capture.toml 'kint' 'kind'", "capture.toml 'units' 'mm'"),
    ),
    "method's keys": (
        described("[methods.2fsk]\ntolerance = 1.0\nf3_hz = 1e9"),
        ("capture.toml 2fsk 'tolerance' 1.0", "capture.toml 2fsk 'f3_hz'"),
    ),
    "method": (described("[methods.2fks]\ntolerance = 1e-3"), ("capture.toml '2fks' '2fsk'",)),
    "contains": (described('contains = ["photos", "no"]'), (": photos", ": no")),
    "outside": (described('contains = ["../secret"]'), ("'../secret'",)),
    "box": (described("box_m = [1, 1, 1, 0, 0, 0]"), ("capture.toml 'box_m'",)),
    "box in mm": (described("box_m = [-50, -50, 10, 50, 50, 90]"), ("capture.toml: warning:",)),
    "target": (described('kind = "target"'), ("target.toml",)),
    "no echoes": (lambda folder: (folder / "echoes.h5").unlink(), ("echoes.h5:",)),
    "one antenna": (
        lambda folder: save_capture(
            folder / "echoes.h5", thin_antennas(load_capture(folder / "echoes.h5"), 9)
        ),
        ("a: same x",),
    ),
    "echoes": (cut("echoes.h5"), ("echoes.h5:",)),
    "truth": (cut("truth.ply"), ("truth.ply:",)),
    "array": (text_of("array.json", "{}"), ("array.json: 'source'",)),
    "transform": (
        text_of("radar_from_photo.json", '{"from": 1,\n "to" 2}'),
        ("radar_from_photo.json: line 2",),
    ),
    "millimetres": (carried(FAR), ("radar_from_photo.json: warning: 400 m",)),
    "behind": (carried(BEHIND), ("radar_from_photo.json: warning: inverse",)),
    "photos": (
        text_of("photos/board.toml", "[[marker]]\nid = 1\n"),
        ("photos: 0", "photos/board.toml:"),
    ),
    "cameras": (
        text_of("photos/cameras.json", '{"cameras": [{"nome": "b.jpg"}]}'),
        ("photos/cameras.json: 'cameras.0.nome'",),
    ),
}


@pytest.mark.parametrize(("change", "places"), CAPTURES.values(), ids=CAPTURES)
def test_a_problem_of_a_capture_is_named_with_its_file(tmp_path, change, places):
    change(folder := make_capture(tmp_path / "a"))
    named(folder, *places)


BENCHES = {
    "keys": ('sead = 3\n[[capture]]\npath = "a"', "", ("b.toml: 'sead' 'seed'",)),
    "captures": (
        "".join(f'[[capture]]\npath = "{path}"\n' for path in ("a", "again", "../none", "missing")),
        "",
        ("b.toml: 'ball'", "none:", "missing:"),
    ),
    "scenes": (
        '[[capture]]\nscene = "scene.toml"\n[[capture]]\nscene = "behind.toml"',
        "",
        ("scene.toml: 'target.edge'", "behind.toml: 30 mm"),
    ),
    "methods": (
        '[[capture]]\npath = "a"',
        '[[method]]\nid = "3fks"\n[[method]]\nid = "narrowband"\nconfig = {drop = 1, thin = 2}\n',
        ("b.toml: '3fks' '3fsk'", "b.toml: 'narrowband' 'drop'", "b.toml: 'thin'"),
    ),
    "tones": (
        '[[capture]]\nscene = "two.toml"\n[[capture]]\npath = "a"',
        '[[method]]\nid = "3fsk"\n[[method]]\nid = "2fsk"\nconfig = {tones_hz = [60e9, 60.2e9]}\n'
        '[[method]]\nid = "2fsk"\nname = "far"\nconfig = {first_depth_m = "auto"}\n',
        (
            *(
                "b.toml: 's' '3fsk' 79.5000",
                "b.toml: 's' '2fsk' 60.0",
                "b.toml: 'ball' '2fsk' 60.0",
            ),
            *("b.toml: 's' 'far' 'auto'", "b.toml: 'ball' 'far' 'auto'"),
        ),
    ),
    "frames": (
        'frames = 9\n[[capture]]\npath = "a"',
        "",
        ("b.toml: 'ball' '2fsk' frame 1", "a: warning: 1 9"),
    ),
    "a truth value": ('seed = true\n[[capture]]\npath = "a"', "", ("b.toml: 'seed' True",)),
    "command": (
        '[[capture]]\npath = "a"',
        '[[method]]\nid = "mine"\ncommand = "no-program {capture} {depth}"\n',
        ("b.toml: 'mine' 'no-program'",),
    ),
    "maps": (
        '[[capture]]\npath = "a"',
        '[[method]]\nid = "mine"\nmaps = "again"\n',
        ("b.toml: 'ball' 'mine' ball.npz",),
    ),
    "calibration": (
        '[[capture]]\npath = "a"\n[calibration]\npath = "a"',
        "",
        ("b.toml: target.toml, photos",),
    ),
}


@pytest.mark.parametrize(("captures", "methods", "places"), BENCHES.values(), ids=BENCHES)
def test_every_problem_of_a_benchmark(tmp_path, captures, methods, places):
    base = tmp_path / "bench"
    for name in ("a", "again"):
        make_capture(base / name)
    scene = 'version = 1\nname = "s"\n[target]\nkind = "sphere"\n'
    (base / "scene.toml").write_text(f"{scene}edge = 1")
    (base / "behind.toml").write_text(f"{scene}distance_m = 1e-4")
    (base / "two.toml").write_text(f"{scene}[sensor]\nsweep = []\ntones_hz = [82e9, 81.8e9]\n")
    methods = methods or '[[method]]\nid = "2fsk"\n'
    (base / "b.toml").write_text(f'version = 1\nname = "b"\n{captures}\n{methods}')
    assert len(named(base / "b.toml", *places)) == len(places)


@pytest.mark.parametrize(
    ("name", "content", "place"),
    [
        ("a.json", json.dumps({"cameras": [{"name": "a.jpg"}]}), "cameras.0"),
        ("a.json", json.dumps({"format": "handbench-array", "tx": {}}), "tx"),
        ("a.json", json.dumps({"from": "photo", "to": "radar"}), "matrix"),
        ("a.json", "[1]", "[1]"),
        ("a.json", "3", "3"),
        ("a.json", '{"cameras": []}', "cameras"),
        ("a.toml", "version =\n", "line 1"),
        ("a.toml", "[[element]]\ncentre_m = 3", "element.0"),
        ("a.npz", "PK", "npz"),
    ],
)
def test_a_file_is_read_as_what_its_name_and_its_keys_say(tmp_path, name, content, place):
    (tmp_path / name).write_text(content)
    named(tmp_path / name, place)


@pytest.mark.parametrize(
    ("kept", "words"), [(np.s_[:], ""), (np.s_[:, ::-1], "inside out"), (np.s_[:2], "one triangle")]
)
def test_a_mesh_inside_out_or_full_of_holes_is_warned_of(tmp_path, kept, words):
    corners_m = 0.1 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    outside = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    write_mesh(tmp_path / "a.ply", mesh(corners_m, outside[kept]))
    assert len(named(tmp_path / "a.ply", words)) == bool(words)


def test_photographs_are_compared_with_their_cameras_and_their_board(tmp_path):
    photos = {"cameras": 3, "width": 600, "height": 400}
    scene = {"version": 1, "name": "ball", "target": {"kind": "sphere"}, "photos": photos}
    write_photos(build(parse(SceneFile, scene, "the ball")), tmp_path)
    folder = tmp_path / "photos"
    (folder / "truth_cameras.json").unlink()
    assert named(folder) == []
    file, board = folder / "cameras.json", folder / "board.toml"
    right = file.read_text()
    turned = {"width": "height", "height": "width"}
    file.write_text(re.sub("width|height", lambda name: turned[name[0]], right))
    assert len(named(folder, "cameras.json: 400 × 600")) == 1
    file.write_text(right)
    content = tomllib.loads(board.read_text())
    for marker in content["marker"]:
        marker["corners_m"] = (10 * np.array(marker["corners_m"])).tolist()
    board.write_text(tomlkit.dumps(content))
    assert len(named(folder, "board.toml: warning:")) == 1


def test_the_command_counts_and_fails(tmp_path, small_bench, capsys):
    scene = small_bench.parent / "ball.toml"
    show([str(small_bench), str(scene)])
    assert capsys.readouterr().out.count("\n") == 2
    for number in range(6):
        folder = make_capture(tmp_path / "data" / f"c{number}", name=f"c{number // 2}")
        if number % 5 == 0:
            (folder / "truth.ply").write_bytes(b"")
    refuse(lambda: show([str(tmp_path / "data")]), "2 problems", "3 warnings", "1 input")
    assert capsys.readouterr().out.count("\n") == 5


def test_every_map_of_a_result_is_read(tmp_path):
    shutil.copytree(GOLDEN / "result", tmp_path, dirs_exist_ok=True)
    for name in ("depth/B__truth.npz", "errors/F__2fsk__truth.npz"):
        (tmp_path / name).write_bytes(b"PK")
    named(tmp_path, "B__truth", "F__2fsk__truth")
