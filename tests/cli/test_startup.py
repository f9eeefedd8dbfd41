"""Each command imports only what it needs: asserted on the modules that are there afterwards, never
on seconds."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

import pytest

from handbench.cli.main import main, parser
from handbench.cli.options import COMMANDS, declared_commands
from handbench.radar.methods.registry import methods
from handbench.support import progress
from tests.small_benchmark import write_bench

HEAVY = [
    "numba",
    "scipy",
    "pandas",
    "matplotlib",
    "cv2",
    "open3d",
    "h5py",
    "dash",
    "rich",
    "argcomplete",
    "IPython",
]
PIXELS = [
    f"--set={axis}.{end}={value}"
    for axis in "xy"
    for end, value in (("start_m", -0.01), ("stop_m", 0.01))
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("start")
    scene = write_bench(made / "bench").parent / "ball.toml"
    assert main(["simulate", str(scene), "-o", str(made / "capture")]) == 0
    command = [
        "reconstruct",
        str(made / "capture"),
        "--method",
        "3fsk",
        "-o",
        str(made / "depth.npz"),
    ]
    assert main([*command, *PIXELS]) == 0
    return made


@pytest.mark.parametrize(
    ("command", "needed"),
    [
        (["list"], set()),
        (["inspect", "bench/ball.toml"], set()),
        (["evaluate", "depth.npz", "--mesh", "capture/truth.ply"], {"open3d", "scipy"}),
        (
            ["reconstruct", "capture", "--method", "3fsk", "-o", "again.npz", *PIXELS],
            {"numba", "scipy", "h5py"},
        ),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_command_imports_what_it_needs(folder, command, needed):
    script = (
        f"import sys\nfrom handbench.cli.main import main\nassert main({command!r}) == 0\n"
        f"print('>', *(m for m in {HEAVY!r} if m in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, env=_env()
    )
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.splitlines()[-1].split()[1:]) == needed
    assert "compiling" not in done.stderr  # the kernels are there already


def test_open3d_s_windows_come_when_they_are_asked_for():
    script = (
        "import sys\nfrom handbench.support.rays import load_open3d\no3d = load_open3d()\n"
        "assert 'dash' not in sys.modules and not hasattr(o3d, 'nonsense')\n"
        "print(o3d.visualization.Visualizer.__name__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=_env()
    )
    assert done.stdout.strip() == "Visualizer", done.stderr


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("handbench recons", {"reconstruct"}),
        ("handbench reconstruct capture --meth", {"--method"}),
        (
            "handbench reconstruct capture --method 3fsk",
            {m.id for m in methods() if m.id.startswith("3fsk")},
        ),
        ("handbench list effect", {"effects"}),
    ],
)
def test_a_shell_completes(line, expected, tmp_path):
    """By argcomplete's protocol, as its shell functions speak it."""
    asked = {
        "_ARGCOMPLETE": "1",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "_ARGCOMPLETE_IFS": "\n",
    }
    asked |= {"_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "said"), "COMP_TYPE": "9"}
    done = subprocess.run(
        [sys.executable, "-m", "handbench.cli.main"], cwd=tmp_path, env=_env() | asked
    )
    assert done.returncode == 0
    assert {word.strip() for word in (tmp_path / "said").read_text().split("\n")} == expected


def test_the_command_s_file_says_that_it_completes():
    import handbench.cli.main as command

    assert b"PYTHON_ARGCOMPLETE_OK" in Path(command.__file__).read_bytes()[:1024]


def walk(parser: argparse.ArgumentParser, names: tuple[str, ...] = ()):
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from ((names, choice.dest, choice.help) for choice in action._choices_actions)
            for name, inner in action.choices.items():
                yield from walk(inner, (*names, name))
        else:
            yield names, "/".join(action.option_strings) or action.dest, action.help


def test_everything_that_can_be_typed_has_help():
    found = list(walk(parser()))
    assert len(found) > 100
    assert [names for *names, text in found if not text] == []


@pytest.mark.parametrize(
    "command",
    [
        ["reconstruct", "capture", "--method", "3fsk", "-o", "x.txt"],
        ["reconstruct", "capture", "--method", "broadband", "-o", "x.npz", "--volume", "x.txt"],
        ["groundtruth", "photos", "-o", "x.txt"],
        ["calibrate", "capture", "-o", "x.txt"],
        ["evaluate", "depth.npz", "--mesh", "m.ply", "--plot", "x.txt"],
        ["show", "depth.npz", "-o", "x.txt"],
    ],
    ids=lambda command: f"{command[0]} {command[-2]}",
)
def test_an_output_of_another_kind_is_refused(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert ended.value.code == 2 and "x.txt does not end in ." in capsys.readouterr().err


def test_sections_of_the_list_are_those_of_its_option(capsys):
    from handbench.cli.list import SECTIONS

    assert declared_commands(COMMANDS)["list"]["options"]["section"]["choices"] == list(SECTIONS)
    assert main(["list", "effects", "noise"]) == 0
    listed = capsys.readouterr().out
    assert "thermal noise" in listed and "roughness" not in listed and "3fsk" not in listed
    assert main(["list", "datasets"]) == 0
    assert "capture.toml" in (told := capsys.readouterr().out) and "planar_scan" in told


def test_a_log_without_a_terminal_tells_the_time_that_is_left(monkeypatch, capsys):
    seconds = iter(range(0, 1000, 30))
    monkeypatch.setattr("handbench.support.progress.time.monotonic", lambda: float(next(seconds)))
    assert list(progress.track(range(4), "imaging")) == [0, 1, 2, 3]
    assert capsys.readouterr().err.splitlines() == [
        "imaging: 0/4", "3 min left, imaging: 1/4", "90 s left, imaging: 2/4", "40 s left, "
                                                                               "imaging: 3/4"
    ]  # fmt: skip


def _env() -> dict[str, str]:
    return dict(os.environ) | {"PYTHONPATH": os.pathsep.join(sys.path)}
