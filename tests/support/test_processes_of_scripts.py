"""Processes that a script's call starts: the script, which says so each time that it runs, runs
once."""

import subprocess
import sys

import pytest

SCRIPT = """
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from handbench.support.parallel import script_left_out

print("here", flush=True)
with script_left_out(), ProcessPoolExecutor(2, get_context("spawn")) as processes:
    print(sum(processes.map(abs, [-1, 2])), flush=True)
assert __file__ == sys.modules["__main__"].__file__ == sys.argv[0]
"""


@pytest.mark.parametrize("as_module", [False, True], ids=["file", "module"])
def test_a_script_without_a_guard_runs_once(tmp_path, as_module):
    (tmp_path / "script.py").write_text(SCRIPT)
    command = [sys.executable, *(["-m", "script"] if as_module else [str(tmp_path / "script.py")])]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert (done.stdout, done.stderr, done.returncode) == ("here\n3\n", "", 0)


LIMITED = """
from handbench.support.parallel import one_blas_thread

with one_blas_thread():
    import scipy.linalg
    from threadpoolctl import threadpool_info

    print(*{blas["num_threads"] for blas in threadpool_info() if blas["user_api"] == "blas"})
"""


def test_a_blas_that_is_loaded_later_is_limited_too():
    """SciPy brings one of its own."""
    command = [sys.executable, "-c", LIMITED]
    environment = {"OPENBLAS_NUM_THREADS": "2", "PATH": ""}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    assert (done.stdout, done.stderr, done.returncode) == ("1\n", "", 0)
