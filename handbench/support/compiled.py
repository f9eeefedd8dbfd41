"""Compilation of loops by numba with the full vector width of the processor, and options for
kernels (compiled loops) that sum in float32.

On processors with AVX-512, LLVM uses half the vector width by default, because the first of these
processors slowed down at full width. handbench's loops are 1.05 to 1.4 times as fast at full width
(measured). The environment variable NUMBA_CPU_FEATURES, if set, overrides this.
"""

from collections.abc import Callable, Iterable
from functools import cache, partial
from multiprocessing import parent_process
from typing import Any

import numba
from numba.core import config
from numba.core.codegen import get_host_cpu_features
from numba.core.registry import cpu_target

from handbench.support.progress import say

# numba.njit without the wrapper for C callers, which takes a fifth of the compile time.
njit: Callable[..., Any] = partial(numba.njit, no_cfunc_wrapper=True)

# Sums may be rearranged into vector code; NaN and infinity keep their meaning.
FAST: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "fastmath": {"contract", "reassoc", "nsz"},
    "error_model": "numpy",
}

# Of kernels that only other kernels call. They are compiled anew as a part of each of these: linked
# from the cache they would be optimised again, and sums would differ in their last bits (3e-7).
INNER: dict[str, Any] = {**FAST, "cache": False, "forceinline": True}

_settings: Any = config  # made as numba is imported
_host: Any = get_host_cpu_features
if _settings.CPU_FEATURES is None and "+avx512f" in (features := _host()):
    _settings.CPU_FEATURES = f"{features},-prefer-256-bit"
cpu_target.target_context  # noqa: B018  # which keeps the features that it meets first


def outer(kernel: Any) -> Any:
    """Return a kernel of the kind INNER as one that Python code calls, and that numba caches."""
    return njit(**FAST)(kernel.py_func)


def announce_compilation(*kernels: Any) -> None:
    """Say once per command, if numba's cache lacks kernels (loops compiled by numba), that they are
    compiled now. Processes that a command starts say nothing."""
    if parent_process() is None and not _cached(kernels):
        _announce()


@cache
def _announce() -> None:
    say("compiling numerical code, once on this machine: a minute or two ...")


def _cached(kernels: Iterable[Any]) -> bool:
    """Tell whether numba need not compile the kernels, because its cache has their code for this
    processor or because compilation is switched off."""
    if getattr(config, "DISABLE_JIT", False):
        return True
    codes = (
        (kernel._cache._cache_file._load_index(), kernel.targetctx.codegen()) for kernel in kernels
    )
    return all(any(key[1] == code.magic_tuple() for key in index) for index, code in codes)
