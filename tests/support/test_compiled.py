"""Compiled loops: the vectors they fill, read off the machine code."""

import os

import numpy as np
import pytest
from numba.core.codegen import get_host_cpu_features

from handbench.support.compiled import FAST, njit


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
