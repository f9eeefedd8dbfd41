"""Every command that writes, at a size that takes seconds: its inputs, one run of it, and what a
fault may leave."""

from __future__ import annotations

import io
import re
import shlex
import shutil
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from unittest.mock import patch

import numpy as np
import tomlkit

from handbench.bench.run import photogrammetry
from handbench.calibration.transforms import Transform
from handbench.cli.main import main
from handbench.groundtruth.mesh.mesh_files import load_open3d, write_mesh
from handbench.support.folder import MARKER
from tests.bench.datasets import test_mapping as foreign
from tests.bench.run.faults import content
from tests.reports.synthetic_result import write_synthetic
from tests.small_benchmark import BENCH, SCENE

ONE = BENCH.rpartition("[[method]]")[0]
AXIS = "{ start_m = -0.02, stop_m = 0.02, step_m = 0.002 }"
SWEPT = (
    f'\n[tradeoff]\nrepeats = 1\n[[tradeoff.imaging]]\nmethod = "3fsk"\nconfig = {{ x = '
    f"{AXIS}, y = {AXIS} }}\n"
)
PIXELS = " ".join(f"--set {axis}.start_m=-0.01 --set {axis}.stop_m=0.01" for axis in "xy")
# the words after `handbench`: {i} is the folder of the inputs, {o} that of the outputs
COMMANDS = {
    "run": "run {i}/one.toml -o {o}/out",
    "simulate": "simulate {i}/ball.toml -o {o}/out",
    "groundtruth": "groundtruth {i}/ball.ply --unit m -o {o}/out.ply",
    "calibrate": "calibrate {i}/capture --maroon {o}/alignment.json -o {o}/transform.json",
    "reconstruct": f"reconstruct {{i}}/capture --method narrowband {PIXELS} --set "
    "z.start_m=0.275 --set z.stop_m=0.285 "
    "--volume {o}/volume.npz -o {o}/depth.npz",
    "report": "report {i}/result -o {o}/out",
    "tradeoff": "tradeoff {i}/swept.toml --sections imaging -o {o}/out",
    "import": "import mapping {i}/foreign -o {o}/out",
    "compare": "compare {i}/result {i}/other -o {o}/out",
    "show": "show target -o {o}/out.svg",
}
# Stands for minutes of photogrammetry, of which `calibrate` writes the outcome.
MEASURED = (
    "calibrate_captures",
    lambda *_, **__: Transform("photo", "radar", np.eye(4), np.diag([1e-5] * 6) ** 2),
)
PRINTING = {  # those that print alone
    "evaluate": "evaluate {i}/depth.npz --mesh {i}/capture/truth.ply",
    "list": "list",
    "inspect": "inspect {i}/one.toml {i}/capture",
}


def write_inputs(folder: Path) -> Path:
    """The inputs of all commands."""
    folder.mkdir()
    write_mesh(
        folder / "ball.ply", load_open3d().geometry.TriangleMesh.create_sphere(0.02, resolution=40)
    )
    benches = {"small": BENCH, "one": ONE, "swept": ONE + SWEPT}
    for name, text in {"ball": SCENE, **benches}.items():
        (folder / f"{name}.toml").write_text(text)
    (folder / "foreign").mkdir()
    foreign.matlab(folder / "foreign" / "hand.mat")
    (folder / "foreign" / foreign.MAPPING).write_text(tomlkit.dumps(foreign.mapping()))
    for name, seed in (("result", 1), ("other", 2)):
        write_synthetic(folder / name, seed=seed, step_m=6e-3)
    for words in (
        f"simulate {folder}/ball.toml -o {folder}/capture",
        f"reconstruct {folder}/capture --method 2fsk {PIXELS} -o {folder}/depth.npz",
    ):
        if (ended := once(words)).code != 0:
            raise RuntimeError(ended.said)
    return folder


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code (None: an exception got out) and what it said on
    stderr."""

    code: int | None
    said: str

    @property
    def loss(self) -> str | None:
        """What a user must never meet, or None."""
        if self.code not in (0, 2):
            return f"ended with {self.code}: {self.said[-2000:]}"
        lines = self.said.strip().splitlines()
        if self.code == 2 and not (lines and lines[-1].startswith("handbench: ")):
            return f"no sentence at the end: {self.said[-500:]}"
        return f"a traceback: {self.said[-600:]}" if "Traceback" in self.said else None


def once(words: str) -> Ended:
    """Run one command in this process."""
    said = io.StringIO()
    with (
        redirect_stderr(said),
        redirect_stdout(io.StringIO()),
        patch.object(photogrammetry, *MEASURED),
    ):
        try:
            code: int | None = main(shlex.split(words))
        except (Exception, SystemExit):
            traceback.print_exc(file=said)
            code = None
    return Ended(code, said.getvalue())


def _content(folder: Path) -> dict[str, bytes]:
    """As `content`, without the line in which a study says how long it took."""
    return {name: re.sub(rb"(?m)^- time: .*$", b"", data) for name, data in content(folder).items()}


@dataclass(frozen=True)
class Command:
    """A command with its inputs and the folder, emptied for every try, in which it writes."""

    name: str
    inputs: Path
    out: Path

    @property
    def words(self) -> str:
        """What follows `handbench`."""
        return COMMANDS[self.name].format(i=self.inputs, o=self.out)

    def empty(self) -> None:
        """Make room for a try."""
        shutil.rmtree(self.out, ignore_errors=True)
        self.out.mkdir(parents=True)

    @cached_property
    def expected(self) -> dict[str, bytes]:
        """What an undisturbed run leaves; of files that hold times, which two runs differ in, the
        names alone."""
        found = []
        for _ in range(2):
            self.empty()
            if (ended := once(self.words)).code != 0:
                raise RuntimeError(f"{self.name}: {ended.said}")
            found.append(_content(self.out))
        return {name: data if found[1][name] == data else b"" for name, data in found[0].items()}

    def differs(self) -> str | None:
        """In what the folder is no longer what an undisturbed run leaves, or None."""
        found = _content(self.out)
        if found.keys() != self.expected.keys():
            return f"other files: {sorted(found.keys() ^ self.expected.keys())[:5]}"
        wrong = [name for name, data in self.expected.items() if data and found[name] != data]
        return f"{wrong[0]} differs" if wrong else None

    def tried(
        self, fault: Callable[[], AbstractContextManager[None]] = nullcontext
    ) -> tuple[bool, str | None]:
        """One run under a fault and one after it, in an empty folder: whether the fault was felt,
        and the loss."""
        self.expected  # noqa: B018, before the folder is emptied
        self.empty()
        with fault():
            ended = once(self.words)
        if ended.loss is not None:
            return True, ended.loss
        felt = ended.code == 2 or " failed" in ended.said
        if not felt:
            return False, self.differs()
        if left := [path.name for path in self.out.rglob(".*") if path.name != MARKER]:
            return True, f"left behind: {left[:3]}"
        after = once(self.words)
        if (
            after.code != 0 and "--overwrite" in after.said
        ):  # it came after the fault: what is there has to be whole
            after = once(f"{self.words} --overwrite")
        return True, after.said if after.code != 0 else self.differs()
