"""Each command imports only what it needs: asserted on the modules that are there afterwards, never
on seconds."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from handbench.cli.options import COMMANDS
from tests.cli.conftest import PIXELS

HEAVY = ["numba", "scipy", "pandas", "matplotlib", "cv2", "open3d", "h5py", "dash", "rich"]
HEAVY += ["argcomplete", "IPython"]
IMAGED = {"numba", "scipy", "h5py"}


def python(folder, script, **more):
    """Run a script in a process of its own."""
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | more
    command = [sys.executable, "-c", script]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, env=env)


@pytest.mark.parametrize(
    ("command", "code", "needed"),
    [
        ("list methods", 0, set()),
        ("inspect bench/ball.toml", 0, IMAGED - {"h5py"} | {"open3d"}),  # its scene is built
        ("evaluate depth.npz --mesh capture/truth.ply", 0, {"open3d", "scipy"}),
        (f"reconstruct capture --method 3fsk -o new.npz {' '.join(PIXELS)}", 0, IMAGED),
        # a wrong path is named before the libraries for the work are imported
        ("evaluate nothing.npz --mesh truth.ply", 2, set()),
        ("reconstruct nothing --method 3fsk -o d.npz", 2, set()),
    ],
)
def test_a_command_imports_what_it_needs(made, command, code, needed):
    script = (
        f"import sys\nfrom handbench.cli.main import main\n"
        f"assert main({command.split()!r}) == {code}\n"
        f"print('>', *(m for m in {HEAVY!r} if m in sys.modules))"
    )
    done = python(made, script)
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.splitlines()[-1].split()[1:]) == needed
    assert "compiling" not in done.stderr  # the kernels are there already


def test_a_shell_completes_commands(tmp_path):
    """By argcomplete's protocol, as its shell functions speak it."""
    line = "handbench re"
    expected = {command for command in COMMANDS if command.startswith("re")}
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    asked |= {"_ARGCOMPLETE_IFS": "\n", "COMP_TYPE": "9"}
    asked |= {"_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "printed")}
    script = "from handbench.cli.main import main; main()"
    assert python(tmp_path, script, **asked).returncode == 0
    assert {word.strip() for word in (tmp_path / "printed").read_text().split("\n")} == expected


def test_help_of_every_command_imports_nothing_heavy_and_leaves_no_word_without_help():
    script = f"""
import argparse, sys
from handbench.cli.main import parser
from handbench.cli.options import COMMANDS
for command in ("", *COMMANDS):
    try: parser().parse_args([*command.split(), "--help"])
    except SystemExit: pass
[commands] = (a for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
typed = [a for inner in commands.choices.values() for a in inner._actions]
assert len(typed) > 90 and all(a.help for a in typed)
sys.exit(", ".join(m for m in {["numpy", "pycolmap", *HEAVY]!r} if m in sys.modules) or None)
"""
    done = python(None, script)
    assert done.returncode == 0, done.stderr


def test_an_output_that_is_full_is_one_line():
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "handbench", "list"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2 and done.stderr.startswith("handbench: ")
