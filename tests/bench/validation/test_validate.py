"""`handbench inspect`: every problem, in the file and on the line where it stands."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.native import CaptureFile, save_capture_file
from handbench.bench.validation.capture_problems import capture_problems
from handbench.bench.validation.inspection import problems_of, show
from handbench.bench.validation.problems import line_of, lines_of
from handbench.calibration.spheres.description import default_target, save_target
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


TEXT = """# a comment with [brackets] and a = b
top = '''
several lines # of text
'''
[one . "two"] # there
key = { a = 1.5, "b" = [ "x]", # here
  2, { deep.er = 3 } ] }
[[list]]
a = 'its' # 1
[[list]]
a = 1979-05-27T07:32:00
[list.under]
b = [[1, 2],
     [3, 4]]
"""
LINES = {
    "top": 2,
    "one.two": 5,
    "one.two.key.a": 6,
    "list": 8,
    "list.0": 8,
    "list.0.a": 9,
    "list.1.a": 11,
    "list.1.under.b": 13,
    "list.1.missing": 10,
}


def test_every_key_has_its_line():
    found = lines_of(TEXT)
    for name, line in LINES.items():
        place = tuple(int(part) if part.isdigit() else part for part in name.split("."))
        assert line_of(found, place) == line, name
    assert line_of(found, ("nothing",)) is None
    text = '{"cameras": [{"name": "a: {b}"},\n{\n"R": [[1, 0], [0, 1]]}]}'
    assert lines_of(text, toml=False)["cameras", 1, "R"] == 3


def test_every_key_of_a_capture_file_that_is_wrong(tmp_path):
    folder = make_capture(tmp_path / "a")
    (folder / "capture.toml").write_text(
        'version = 2\nname = "a/b"\nkint = "hand"\ndistance_m = "near"\nunits = "mm"\n'
        'contains = [\n  "echoes.h5",\n  "photos", 7,\n  "../secret",\n]\n'
        "[methods.2fsk]\nf1_hz = -1.0\nf3_hz = 1e9\n[methods.2fks]\nf1_hz = 1.0\n"
    )
    same(
        found_in(folder),
        ("capture.toml:1", "'version' is 2; input should be 1"),
        ("capture.toml:2", "'a/b' cannot be the name of a file"),
        ("capture.toml:3", "unknown key 'kint'; did you mean 'kind'"),
        ("capture.toml:4", "'distance_m' is 'near'"),
        ("capture.toml:5", "'units' is 'mm'; input should be 'm'"),
        ("capture.toml:6", "photos is listed but missing"),
        ("capture.toml:6", r"'contains\.2' is 7"),
        ("capture.toml:6", r"'\.\./secret' is outside the folder"),
        ("capture.toml:12", "'methods.2fsk.f1_hz' is -1.0"),
        ("capture.toml:13", "unknown key 'methods.2fsk.f3_hz'; did you mean 'f[12]_hz'"),
        ("capture.toml:14", "unknown id '2fks'; did you mean '2fsk'"),
    )
    (folder / "capture.toml").write_text('version = 1\nname = "a\n')
    [problem] = found_in(folder)
    assert problem.startswith("capture.toml:2: is not readable as TOML")


BENCH = """version = 1
name = "b"
repeats = 4
sead = 3
[groundtruth]
quality = "best"
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
[[capture]]
path = "unregistered"
[[method]]
id = "2fsk"
precision = true
[[method]]
id = "3fks"
[[method]]
id = "narrowband"
[method.config]
threshold_db = "low"
[method.config.x]
stap_m = 0.1
"""


def test_every_problem_of_a_benchmark(tmp_path):
    base = tmp_path / "bench"
    for name in ("a", "again"):
        make_capture(base / name, frames=4)
    unregistered = make_capture(base / "unregistered", name="u", frames=3)
    (unregistered / "truth.ply").rename(unregistered / "mesh.ply")
    (unregistered / "capture.toml").write_text('version = 1\nname = "u"\n')
    (base / "scene.toml").write_text(
        'version = 1\nname = "s"\n[target]\nkind = "mesh"\npath = "x.ply"\nradius_m = 1\n'
    )
    (base / "b.toml").write_text(BENCH)
    same(
        found_in(base / "b.toml"),
        ("b.toml:4", "unknown key 'sead'; did you mean 'seed'"),
        ("b.toml:6", "'groundtruth.quality' is 'best'"),
        ("b.toml:9", "capture 'ball' in again has the same name as the one in a"),
        ("b.toml:12", r"'\.\./a' is outside the folder"),
        ("b.toml:14", "missing is missing"),
        ("scene.toml:6", "unknown key 'target.radius_m'"),
        ("b.toml:17", "'u' has 3 frames, but the precision of '2fsk' needs repeats = 4"),
        ("b.toml:17", "'u': nothing transforms its surface to the radar frame"),
        ("b.toml:23", "unknown id '3fks'; did you mean '3fsk'"),
        ("b.toml:27", "'method.2.config.threshold_db' is 'low'"),
        ("b.toml:28", "'method.2.config.x.start_m' is missing"),
        ("b.toml:28", "'method.2.config.x.stop_m' is missing"),
        ("b.toml:28", "'method.2.config.x.step_m' is missing"),
        ("b.toml:29", "unknown key 'method.2.config.x.stap_m'; did you mean 'st[a-z]+_m'"),
    )


def test_a_calibration_a_data_set_and_kept_maps_that_are_missing(tmp_path):
    make_capture(tmp_path / "a")
    (tmp_path / "b.toml").write_text(
        'version = 1\nname = "b"\n[[calibration]]\npath = "a"\n[[dataset]]\npath = "set"\n'
        '[[capture]]\npath = "a"\n[[method]]\nid = "own"\nmaps = "../maps"\n'
    )
    same(
        found_in(tmp_path / "b.toml"),
        ("b.toml:3", r"the capture for the calibration has no target\.toml, photos; add what is"),
        ("b.toml:6", "set: expected a folder"),
        ("b.toml:9", r"'\.\./maps' is outside the folder"),
    )


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("nowhere", None, "nowhere"),
        ("cams.xml", "<document/>", r"does not read \.xml files; .* --cameras"),
        ("folder/tradeoff.json", "{}", "tradeoff"),
        (
            "target.toml",
            "foam_permitivity = 1.03\n[[element]]\n",
            "did you mean 'foam_permittivity",
        ),
        ("board.toml", "[charuco]\ncolumms = 4\n", "did you mean 'columns'"),
    ],
)
def test_every_other_kind_of_input_is_named_in_its_problem(tmp_path, name, text, words):
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    if text is not None:
        file.write_text(text)
    found = [str(p) for p in problems_of(str(file if file.parent == tmp_path else file.parent))]
    assert any(re.search(words, problem) for problem in found)


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


def test_frames_without_their_truths_are_named(tmp_path):
    folder = make_capture(tmp_path / "a", frames=2)
    (folder / "truth").mkdir()
    for frame in range(3):
        shutil.copyfile(folder / "truth.ply", folder / "truth" / f"{frame:03d}.ply")
    words = "has 3 surfaces, but the capture has 2 frames"
    assert any(p.startswith("truth: ") and words in p for p in found_in(folder))
    (folder / "truth" / "002.ply").unlink()
    assert not any("frames" in problem for problem in found_in(folder))
    (folder / "truth" / "001.ply").unlink()
    words = r"truth: .*001\.ply is missing, but the capture has 2 frames"
    assert any(re.match(words, problem) for problem in found_in(folder))


def test_a_capture_without_its_parts_is_named(tmp_path):
    folder = make_capture(tmp_path / "a", kind="target")
    same(found_in(folder), (".", "capture of the calibration target without target.toml"))
    save_target(folder / "target.toml", default_target())
    assert found_in(folder) == []
    text = (folder / "target.toml").read_text()
    (folder / "target.toml").write_text(text.replace("0.06", "60", 1))
    [problem] = found_in(folder)
    assert re.match(r"target\.toml:\d+: warning: centre_m is 60 m; check that it is in", problem)
    (folder / "target.toml").unlink()
    for name in ("capture.toml", "truth.ply"):
        (folder / name).unlink()
    same(found_in(folder), ("capture.toml", "expected a capture description"))
    words = "has no surface to compare depths with"
    assert words in "".join(problem.text for problem in capture_problems(folder, scored=True))


def test_millimetres_are_suspected_in_words_that_say_so(tmp_path, capsys):
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
    show([str(folder)])
    assert capsys.readouterr().out.endswith(
        "6 warnings, 1 input; correct the warnings listed above, unless they are intended\n"
    )
    matrix[:3, 3] = (0, 0, -0.5)
    folder = make_capture(tmp_path / "b")
    shutil.copyfile(folder / "truth.ply", folder / "mesh.ply")
    Transform("photo", "radar", matrix).save(folder / "radar_from_photo.json")
    same(
        found_in(folder),
        ("radar_from_photo.json", "behind the radar; check that it is not the inverse"),
    )
    (folder / "capture.toml").write_text('version = 1\nname = "b"\nbox_m = [0, 0, 0, 1, 1, -1]\n')
    assert any(problem.startswith("capture.toml:3: box_m is") for problem in found_in(folder))


SCENE = 'version = 1\nname = "s"\n'
SPHERE = f'{SCENE}[target]\nkind = "sphere"\n[sensor]\nsweep = []\ntones_hz = [82e9, 81.8e9]\n'
TWO = """version = 1
name = "b"
[[capture]]
path = "a"
[[capture]]
scene = "s.toml"
[[method]]
id = "3fsk"
[[method]]
id = "nfsk"
config = { tones_hz = [82e9, 81.8e9, 79.5e9] }
"""


def test_a_scene_s_files_and_tones_are_checked_where_they_are_named(tmp_path):
    (tmp_path / "x.ply").write_text("ply")
    file = tmp_path / "s.toml"
    for name, words in (
        ("x.ply", "has no triangles"),
        ("../x.ply", "is outside the folder"),
        ("y.ply", "nothing"),
    ):
        array = '[sensor]\narray = "radar"\n'
        file.write_text(f'{SCENE}[target]\nkind = "mesh"\npath = "{name}"\n{array}')
        same(found_in(file), ("s.toml:5", words), ("s.toml:7", "tx"), ("s.toml:7", "rx"))
    make_capture(tmp_path / "a")
    file.write_text(SPHERE)
    (tmp_path / "b.toml").write_text(TWO)
    words = "'s' with method '{}': frequencies: the method needs a tone at 79.5000 GHz"
    expected = [("b.toml:5", words.format(id)) for id in ("3fsk", "nfsk")]
    same(found_in(tmp_path / "b.toml"), *expected)
    about = 'version = 1\nname = "a"\n[methods.3fsk]\nf3_hz = 72e9\n'
    (tmp_path / "a" / "capture.toml").write_text(about)
    words = "'a' with method '3fsk': frequencies: the method needs a tone at 72"
    assert any(words in problem for problem in found_in(tmp_path / "b.toml"))


@pytest.mark.parametrize(
    ("has", "words"),
    [
        ((), "can be imaged; to compare its depths with a surface, add photos or mesh.ply"),
        (
            ("mesh.ply",),
            "can be imaged; to compare its depths with a surface, add radar_from_photo",
        ),
        (("mesh.ply", "radar_from_photo.json"), "can be compared with its surface"),
    ],
)
def test_a_capture_of_echoes_is_fine_and_says_what_a_comparison_needs(tmp_path, capsys, has, words):
    folder = make_capture(tmp_path / "a")
    save_capture_file(folder, CaptureFile(name="a"))
    (folder / "truth.ply").rename(folder / "mesh.ply")
    Transform("photo", "radar", np.eye(4)).save(folder / "radar_from_photo.json")
    for name in {"mesh.ply", "radar_from_photo.json"} - {*has}:
        (folder / name).unlink()
    assert list(problems_of(str(folder))) == []
    assert words in capsys.readouterr().out


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
