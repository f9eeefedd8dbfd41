"""Compiled loops: the vectors they fill, read off the machine code; who compiles them, and where
they are kept."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numba.core.codegen import get_host_cpu_features

from handbench.radar.imaging.boxes import gather
from handbench.support import compiled
from handbench.support.compiled import FAST, njit

# compiles as soon as all processes are there
CALL = """
import sys
from pathlib import Path
import numpy as np
from handbench.radar.imaging.skeleton import _pivoted_cholesky as kernel
Path(sys.argv[1]).touch()
while not all(Path(name).exists() for name in sys.argv[2:]):
    pass
kernel(np.eye(3), 0.1, np.ones(3), np.zeros(3, int), np.eye(3))
print(sum(kernel.stats.cache_misses.values()), sum(kernel.stats.cache_hits.values()))
"""


def test_loops_fill_whole_vectors():
    if "+avx512f" not in get_host_cpu_features():
        pytest.skip("this processor has no AVX-512")
    if "NUMBA_CPU_FEATURES" in os.environ:
        pytest.skip("NUMBA_CPU_FEATURES decides")

    @njit(**{**FAST, "cache": False})
    def scaled(values, out):
        for i in range(len(values)):
            out[i] = np.float32(2) * values[i] + np.float32(1)

    scaled(np.ones(4, np.float32), np.empty(4, np.float32))
    [code] = scaled.inspect_asm().values()
    assert "zmm" in code


def test_of_two_processes_one_compiles_and_says_so_once(tmp_path):
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    names = [str(tmp_path / name) for name in "ab"]
    commands = [[sys.executable, "-c", CALL, name, *names] for name in names]
    begun = [subprocess.Popen(c, stdout=-1, stderr=-1, text=True, env=env) for c in commands]
    printed, said = zip(*(process.communicate() for process in begun), strict=True)
    assert sorted(line.split() for line in printed) == [["0", "1"], ["1", "0"]]
    assert sorted(text.count("\n") for text in said) == [0, 1]


def test_a_compilation_for_another_processor_is_announced_once(monkeypatch, capsys):
    monkeypatch.setattr(type(gather.targetctx.codegen()), "magic_tuple", lambda _: ("another",))
    compiled._announce.cache_clear()
    compiled.announce(gather)
    compiled.announce(gather)
    assert capsys.readouterr().err.count("\n") == 1


def test_without_a_place_for_compiled_code_nothing_is_written_to_the_current_folder(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(compiled, "__file__", "/proc/read-only/compiled.py")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as without a home
    assert compiled._kept() is None
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    ("name", "value"),
    [("NUMBA_CACHE_DIR", "/proc/none"), ("NUMBA_NUM_THREADS", "0"), ("NUMBA_OPT", "junk")],
)
def test_a_setting_that_numba_cannot_use_is_one_line(name, value):
    script = "from handbench.cli import installed, main\n"
    script += "installed.doctor = lambda _: __import__('handbench.support.compiled')\n"
    script += "raise SystemExit(main.main(['doctor']))"
    done = subprocess.run(
        [sys.executable, "-c", script], stderr=-1, text=True, env=os.environ | {name: value}
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and name in done.stderr
