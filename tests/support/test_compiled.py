"""Compiled loops: the vectors they fill, read off the machine code, and the one place that they
come from."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from numba.core.codegen import get_host_cpu_features

from handbench.support.compiled import FAST, njit
from tests.installed_copy import ROOMS

ROOT = Path(__file__).parents[2]


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


def test_all_loops_come_from_here():
    """A loop that is compiled by numba itself before this module is imported would decide the
    vectors of all others."""
    asked = re.compile(r"^(import numba$|from numba import)", re.MULTILINE)
    importing = {
        str(file.relative_to(ROOT))
        for room in (*ROOMS, "handbench")
        for file in (ROOT / room).rglob("*.py")
        if asked.search(file.read_text("utf-8")) and "studies" not in file.parts
    }
    assert importing == {"handbench/support/compiled.py"}


def test_scipy_stats_is_imported_where_it_is_used():
    """Importing it takes a second; studies alone may as they begin."""
    files = [file for room in (*ROOMS, "handbench") for file in (ROOT / room).rglob("*.py")]
    importing = re.compile(r"^(from|import) scipy.*stats", re.MULTILINE)
    assert not [
        file
        for file in files
        if "studies" not in file.parts and importing.search(file.read_text("utf-8"))
    ]
