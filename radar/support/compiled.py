"""Compiled loops: numba, with the processor's whole vectors, and the options of kernels that sum in float32.

LLVM fills half of the vectors of a processor with AVX-512, since the first of these slowed down under whole ones. The
loops here run 1.05 to 1.4 times as fast with whole ones (measured). NUMBA_CPU_FEATURES decides where it is set.
"""

from typing import Any

from numba import get_num_threads, njit, prange, set_num_threads
from numba.core import config
from numba.core.codegen import get_host_cpu_features
from numba.core.registry import cpu_target

__all__ = ["FAST", "get_num_threads", "njit", "prange", "set_num_threads"]

# Sums may be rearranged into vector code; NaN and infinity keep their meaning.
FAST: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "fastmath": {"contract", "reassoc", "nsz"},
    "error_model": "numpy",
}

_settings: Any = config  # made as numba is imported
_host: Any = get_host_cpu_features
if _settings.CPU_FEATURES is None and "+avx512f" in (features := _host()):
    _settings.CPU_FEATURES = f"{features},-prefer-256-bit"
cpu_target.target_context  # noqa: B018  # which keeps the features that it meets first
