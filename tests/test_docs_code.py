"""The code of README, CONTRIBUTING and docs runs, and the commands of RUN: each block once, one
after another, in one folder and one namespace. Code prints the block of text below it; as many
commands are refused as a page shows refusals."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handbench.bench.evaluation import metrics
from handbench.cli.main import main
from handbench.groundtruth.mesh.surface import mesh, write_mesh
from handbench.radar.methods import registry as method_table
from handbench.radar.simulation.catalogue import Effect
from handbench.support.config import Config
from tests.test_docs import DOCS, FENCE, PAGES, ROOT, blocks

NOT_RUN = (  # how a block begins: with arguments, on a cluster, inside a function
    "import sys\n\nimport h5py",
    "import subprocess\nfrom dask_jobqueue",
    '        "within_2mm": observed',
    '            "within_2mm_percent": 100',
)
SLOW = ("docs/tutorial.md", "docs/own_data.md", "docs/python.md", "docs/array.md")
RUN = {  # page → what its commands name if they run
    "docs/tutorial.md": r"hand.toml -o|capture|3fsk.npz|(first|second).toml|runs/first",
    "docs/own_data.md": r" array\b",
    "docs/array.md": r" capture\b",
}


def prepare(page: str, names: dict[str, Any]) -> None:
    """Make what a page has from another one."""
    if page in ("README.md", "docs/python.md"):
        exec(blocks(DOCS / "own_data.md", "python")[0], {})
        corners_m = 0.02 * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
        plate = mesh(corners_m + (0.010, -0.020, 0.300), np.array([(0, 2, 1), (0, 3, 2)]))
        write_mesh(Path("mine.ply"), plate)
    if page == "CONTRIBUTING.md":  # what the file that its block is added to imports
        names |= vars(method_table) | {"__name__": "page"}
        names |= {"Config": Config, "Effect": Effect, "Imbalance": object}
        names |= {"Metric": metrics.Metric}


@pytest.fixture
def registry():
    """The table of methods; those that a page adds are gone afterwards."""
    known = dict(method_table.METHODS)
    yield
    method_table.METHODS.clear()
    method_table.METHODS.update(known)


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=name, marks=[pytest.mark.slow] if name in SLOW else [])
        for page in PAGES
        for name in [page.relative_to(ROOT).as_posix()]
        if blocks(page, "python")
    ],
)
def test_a_page_runs(page, tmp_path, monkeypatch, registry):
    name = page.relative_to(ROOT).as_posix()
    names: dict[str, Any] = {"__name__": "page"}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(metrics, "METRICS", dict(metrics.METRICS))  # which a recipe adds to
    prepare(name, names)
    output, codes, refusals = "", [], 0
    above, *rest = FENCE.split(page.read_text("utf-8"))
    for language, code, below in zip(rest[::3], rest[1::3], rest[2::3], strict=True):
        if saved := re.search(r"[Ss]ave\s+this\s+as\s+`([^`]+)`", above):
            Path(saved[1]).write_text(code, "utf-8")
        elif language == "python" and not code.startswith(NOT_RUN):
            with contextlib.redirect_stdout(io.StringIO()) as stream:
                exec(compile(textwrap.dedent(code), name, "exec"), names)
            output = stream.getvalue()
            for test in re.findall(r"def (test_\w+)", code):  # a recipe's own
                names[test]()
        elif language == "text":
            assert output == code
        elif not language and name in RUN and code.startswith("handbench "):
            typed = [line for line in code.splitlines() if re.search(RUN[name], line)]
            codes += [main(shlex.split(line, comments=True)[1:]) for line in typed]
        elif not language and codes:
            refusals += code.startswith("handbench: ")
        above = below
    assert codes.count(2) == refusals and sum(codes) == 2 * refusals
