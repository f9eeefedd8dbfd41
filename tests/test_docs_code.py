"""Every Python block of README, CONTRIBUTING and docs is executed, or named below with its reason;
what a block prints is what the page says. The blocks of a page run one after another, in one folder
and one namespace."""

from __future__ import annotations

import contextlib
import importlib
import io
import re
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from handbench.calibration.spheres.description import default_target
from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.methods.registry import METHODS, method
from handbench.radar.simulation.catalogue import Effect
from handbench.radar.simulation.physics.spheres import sphere_echo
from handbench.support.config import Config
from tests.radar.simulated_points import point_capture
from tests.test_docs import DOCS, FENCE, PAGES, ROOT, blocks

NOT_RUN = {  # how a block begins → why it is not executed here
    "import sys\n\nimport h5py": "docs/submissions.md: takes arguments; run in "
    "tests/bench/run/test_foreign_methods.py",
    "import subprocess\nfrom dask_jobqueue": "docs/cluster.md: starts jobs on a SLURM cluster",
    '        "within_2mm": observed': "CONTRIBUTING.md: an entry of a dictionary inside a function",
    '            "within_2mm_percent": 100': "CONTRIBUTING.md: an entry of a dictionary inside a "
    "function",
}


def of_point(folder: Path, names: dict[str, Any]) -> None:
    """The capture `mine` of own_data.md, and a plate through its point as `mine.ply`."""
    exec(blocks(DOCS / "own_data.md", "python")[0], {})
    corners_m = np.array([0.010, -0.020, 0.300]) + 0.02 * np.array(
        [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    )
    write_mesh(folder / "mine.ply", mesh(corners_m, np.array([(0, 2, 1), (0, 3, 2)])))


def of_arrays(folder: Path, names: dict[str, Any]) -> None:
    """Captures of the calibration target and of a point, by every third antenna and 32 tones."""
    array = AntennaArray(qar50().tx_m[::3], qar50().rx_m[::3])
    tones_hz, target = np.linspace(72e9, 82e9, 32), default_target()
    balls = zip(
        target.centres_m + [0.0, 0.0, 0.31], target.element, target.foam_delay_m, strict=True
    )
    seen = sum(
        sphere_echo(centre_m, e.ball_radius_m, d, tones_hz, array) for centre_m, e, d in balls
    )
    noise = np.random.default_rng(0).standard_normal((*seen.shape, 2)) @ [1, 1j]
    seen = seen + 0.01 * np.abs(seen).mean() * noise
    capture = RadarCapture(seen[None].astype(np.complex64), tones_hz, array)
    for name in ("target", "hand"):
        (folder / name).mkdir()
        save_capture(folder / name / "echoes.h5", capture)
        (folder / name / "capture.toml").write_text(f'version = 1\nname = "{name}"\n', "utf-8")
    (folder / "target" / "target.toml").write_text(tomlkit.dumps(target.model_dump()), "utf-8")


def of_tutorial(folder: Path, names: dict[str, Any]) -> None:
    """A depth map as `3fsk.npz`."""
    chosen = method("3fsk")
    small = {axis: {"start_m": -0.01, "stop_m": 0.01, "step_m": 0.002} for axis in "xy"}
    chosen.run(point_capture((0.0, 0.0, 0.3)), chosen.configure(small, "test"), 0).depth.save(
        "3fsk.npz"
    )


def of_contributor(folder: Path, names: dict[str, Any]) -> None:
    """What the files that the page's blocks are added to know already."""
    for module in ("handbench.radar.methods.presets", "tests.hard_cases.test_smoothing_cases"):
        known = vars(importlib.import_module(module)).items()
        names.update({name: value for name, value in known if not name.startswith("__")})
    names["Config"], names["Effect"] = Config, Effect


PREPARED: dict[str, Callable[[Path, dict[str, Any]], None]] = {
    "README.md": of_point,
    "CONTRIBUTING.md": of_contributor,
    "docs/array.md": of_arrays,
    "docs/python.md": of_point,
    "docs/tutorial.md": of_tutorial,
}


def ran(page: Path) -> list[tuple[str, str]]:
    """The page's Python blocks, each with the text block behind it, "" where there is none."""
    found = FENCE.findall(page.read_text("utf-8"))
    after = [*found, ("", "")][1:]
    return [
        (code, output if kind == "text" else "")
        for (language, code), (kind, output) in zip(found, after, strict=bool(found))
        if language == "python"
    ]


@pytest.fixture
def registry():
    """The built-in methods; those that a page registers are gone afterwards."""
    method("2fsk")  # loads them
    known = dict(METHODS)
    yield
    METHODS.clear()
    METHODS.update(known)


@pytest.mark.parametrize(
    "page", [p for p in PAGES if ran(p)], ids=lambda page: page.relative_to(ROOT).as_posix()
)
def test_the_code_of_a_page_runs_and_prints_what_it_says(page, tmp_path, monkeypatch, registry):
    name, names = page.relative_to(ROOT).as_posix(), {"__name__": "page"}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "handbench.radar.simulation.causes.Imbalance", object, raising=False
    )  # which CONTRIBUTING.md adds
    PREPARED.get(name, lambda folder, names: None)(tmp_path, names)
    for code, output in ran(page):
        if not code.startswith(tuple(NOT_RUN)):
            with contextlib.redirect_stdout(io.StringIO()) as printed:
                exec(compile(textwrap.dedent(code), name, "exec"), names)
            assert not output or printed.getvalue() == output
        for test in re.findall(
            r"def (test_\w+)", code
        ):  # a recipe's own, of what its blocks before made
            names[test]()
