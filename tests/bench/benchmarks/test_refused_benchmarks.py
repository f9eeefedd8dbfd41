"""What a benchmark asks wrongly is refused with its place, when it is loaded and inspected."""

from pathlib import Path

import pytest

from handbench.bench.benchmarks.benchmark_file import DataSet, load_benchmark
from handbench.bench.validation.inspection import inspect
from handbench.support.files import real
from tests.refusals import refuse

HAND = 'scene = "hand.toml"'
CAPTURES = {
    f"{HAND}\nset = {{ seed = 1 }}": "suffix",
    'path = "capture"\nsuffix = "fast"': "suffix",
    f"{HAND}\npersons = [0]": "persons",
    'path = "capture"\npersons = [1]': "persons",
    f'{HAND}\nmeasures = ["speed"]': "measures",
    f'{HAND}\nmeasures = ["precision"]': "accuracy",
    f'{HAND}\n[[capture]]\n{HAND}\nmeasures = ["precision"]': "precision = true",
}
METHODS = {
    'id = "2fsk"\nsweep = { tolerence = [1e-3] }': "'tolerance'",
    'id = "2fsk"\nsweep = { "tolerance.a" = [1] }': "tolerance.a",
    'id = "2fsk"\nsweep = { tolerance = [] }': "tolerance",
    'id = "2fsk"\nsweep = { tolerance = [1e-3, 1e-3] }': "tolerance-1e-3",
    'id = "2fsk"\nsweep = { every_nth_antenna = [0] }': "every_nth_antenna",
    f'id = "2fsk"\nsweep = {{ seed = {[1] * 40}, tolerance = {[1] * 40} }}': "1600",
    'id = "2fsk"\nname = "3fsk"': "'3fsk'",
    'id = "3-FSK"\nmaps = "m"': "'3-FSK'",
    'id = "Ｔruth"\nmaps = "m"': "ruth'",
    'id = "mine"\nmaps = "m"\nsweep = { tolerance = [1] }': "sweep",
    'id = "mine"\nmaps = "m"\ncommand = "a {capture} {depth}"': "'mine'",
    'id = "mine"\ncommand = "mine {capture}"': "'mine'",
}


def written(folder: Path, capture: str, method: str) -> str:
    """The path of a benchmark, beside two scenes."""
    for name, pose in {"hand": 'pose = "B"', "sphere": ""}.items():
        scene = f'version = 1\nname = "{name}"\n[target]\nkind = "{name}"\n{pose}\n'
        (folder / f"{name}.toml").write_text(scene)
    file = folder / "b.toml"
    file.write_text(f'version = 1\nname = "b"\n[[capture]]\n{capture}\n[[method]]\n{method}\n')
    return str(file)


@pytest.mark.parametrize(
    ("capture", "method", "place"),
    [
        *((capture, 'id = "2fsk"', place) for capture, place in CAPTURES.items()),
        *((HAND, method, place) for method, place in METHODS.items()),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path, capture, method, place):
    file = written(tmp_path, capture, method)
    refuse(lambda: load_benchmark(file), file, place)
    assert any(place in problem for problem in inspect(file).lines)


def test_an_unknown_method_names_the_nearest(tmp_path):
    file = written(tmp_path, HAND, 'id = "2fsk"')
    refuse(lambda: load_benchmark(file, ("2fks",)), "'2fks'", "'2fsk'")


@pytest.mark.parametrize(
    ("capture", "places"),
    [
        ('scene = "sphere.toml"\npersons = [1]', ("'sphere'", "persons")),
        (f"{HAND}\npersons = [4]\n[[capture]]\n{HAND}\npersons = [4]", ("'hand-person-04'",)),
        (f'{HAND}\nsuffix = "b"\nset = {{ target.person = "me" }}', ("'hand-b'", "target.person")),
    ],
)
def test_what_does_not_fit_its_scene_is_named(tmp_path, capture, places):
    """Such as persons of a ball, and one person twice."""
    lines = inspect(written(tmp_path, capture, 'id = "2fsk"')).lines
    assert any(all(place in line for place in places) for line in lines), lines


def test_data_may_lie_elsewhere(tmp_path):
    """Beside the benchmark's folder, at an absolute path, or behind a link."""
    (folder := tmp_path / "F" / "a").mkdir(parents=True)
    (folder / "capture.toml").write_text('version = 1\nname = "a"\n')
    (base := tmp_path / "bench").mkdir()
    (base / "link").symlink_to(tmp_path / "F")
    for path in ("../F", str(tmp_path / "F"), "link"):
        [source] = DataSet(path=path).sources(base)
        assert real(base, source.path or "", "") == folder
