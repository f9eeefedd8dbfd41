"""The notebooks of examples/ run from the first cell to the last, and are stored without
outputs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RUN = """
import sys, nbformat
from nbclient import NotebookClient
notebook = nbformat.read(sys.argv[1], as_version=4)
NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
for cell in notebook.cells:
    print([output.get("data", {}).keys() for output in cell.get("outputs", [])])
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["compare_methods", "first_depth_map", "own_echoes"])
def test_a_notebook_runs_and_draws(name, tmp_path):
    """In a kernel and a folder of its own; its own assertions hold, and it shows at least one
    picture."""
    notebook = ROOT / "examples" / f"{name}.ipynb"
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    places = {"PYTHONPATH": str(ROOT), "IPYTHONDIR": str(tmp_path / "ipython"), "MPLBACKEND": ""}
    command = [sys.executable, "-c", RUN, str(notebook)]
    env = {**os.environ, **places}
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "image/png" in done.stdout
