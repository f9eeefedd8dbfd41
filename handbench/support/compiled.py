"""Compilation of loops by numba: kernels with the full vector width of the processor, options for
those that sum in float32, and their cache on the disk.

On processors with AVX-512, LLVM uses half the vector width by default, because the first of these
processors slowed down at full width. handbench's loops are 1.05 to 1.4 times as fast at full width
(measured). The environment variable NUMBA_CPU_FEATURES, if set, overrides this.

Compiled kernels are kept next to the code or, where that cannot be written, in the user's cache;
NUMBA_CACHE_DIR names another folder.
"""

import atexit
import fcntl
import os
import shutil
import tempfile
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import import_module
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

from handbench.support.errors import HandbenchError
from handbench.support.progress import say

CACHE = "NUMBA_CACHE_DIR"
COMPILE_S = 10  # processor time of all kernels of a first `handbench demo`, measured

# Sums may be rearranged into vector code; NaN and infinity keep their meaning.
FAST: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "fastmath": {"contract", "reassoc", "nsz"},
    "error_model": "numpy",
}

# Of kernels that only other kernels call. They are compiled anew as a part of each of these: linked
# from the cache they would be optimised again, and sums would differ in their last bits (3e-7).
INNER = {**FAST, "cache": False, "forceinline": True}


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _kept() -> Path | None:
    """Return the folder for compiled kernels, if it is a `__pycache__` one beside each module; None
    if none can be written. Raises HandbenchError if NUMBA_CACHE_DIR names one that cannot."""
    if named := os.environ.get(CACHE):
        if not _writable(Path(named)):
            raise HandbenchError(
                f"{CACHE}: the folder '{named}' cannot be written; name one that can, or unset it"
            )
        return Path(named)
    of_user = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    places = Path(__file__).parent / "__pycache__", Path(of_user, "numba")
    # without a home, ~ stays ~
    return next((place for place in places if place.is_absolute() and _writable(place)), None)


def _numba(folder: Path | None) -> Any:
    """Import numba, which reads its settings from environment variables as it is imported. Raises
    HandbenchError if it cannot. folder: for compiled kernels (None: a temporary one, which the
    processes of one command share)."""
    if folder is None:
        folder = Path(tempfile.mkdtemp(prefix="handbench-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    if folder.name != "__pycache__":
        os.environ[CACHE] = str(folder)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "Environment variable 'NUMBA_")
        try:
            return import_module("numba")
        except (RuntimeWarning, ValueError) as error:
            raise HandbenchError(
                f"NUMBA_NUM_THREADS, or another variable of numba: {str(error).splitlines()[0]} "
                "Correct or unset it"
            ) from None


KEPT = _kept()
numba = _numba(KEPT)
_settings: Any = import_module("numba.core.config")
_host: Any = import_module("numba.core.codegen").get_host_cpu_features
if _settings.CPU_FEATURES is None and "+avx512f" in (features := _host()):
    _settings.CPU_FEATURES = f"{features},-prefer-256-bit"
_target: Any = import_module("numba.core.registry").cpu_target
_target.target_context  # noqa: B018  # which keeps the features that it meets first

_spent_s = 0.0  # on compiling kernels and on loading them from the cache


def clock_s() -> float:
    """Return the time of a clock, in seconds, that stands still while a kernel is compiled or
    loaded from the cache, which happens when it is first called."""
    return time.perf_counter() - _spent_s


class KernelCache(import_module("numba.core.caching").FunctionCache):  # type: ignore[misc]
    """numba's cache of one kernel. Of several processes that need a kernel that it lacks, one
    compiles it; the others wait, and load it."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a kernel for the types of its arguments; None if this process must compile it, and
        then `save_overload` it."""
        self._begun_s, self._lock = time.perf_counter(), None
        with suppress(OSError):  # a file system without locks: each process compiles
            file = Path(self.cache_path, f"{self._impl.filename_base}.lock")
            self._lock = os.open(file, os.O_CREAT | os.O_RDWR)
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        code = super().load_overload(sig, target_context)
        if code is None:
            _announce()
        else:
            self._end()
        return code

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a kernel that this process has compiled."""
        super().save_overload(sig, data)
        self._end()

    def _end(self) -> None:
        global _spent_s
        if self._lock is not None:
            os.close(self._lock)
        _spent_s += time.perf_counter() - self._begun_s


def njit(cache: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that makes a function a kernel, as numba.njit does with these options.
    cache: keep it on the disk, by `KernelCache`."""

    def compiled(function: Callable[..., Any]) -> Any:
        # without the wrapper for C callers, which takes a fifth of the compile time
        kernel = numba.njit(no_cfunc_wrapper=True, **options)(function)
        if cache and kernel is not function:  # as it is with NUMBA_DISABLE_JIT
            kernel._cache = KernelCache(function)
        return kernel

    return compiled


def announce(kernel: Any) -> None:
    """Say that kernels are compiled, in place of the processes that a command is about to start, if
    the cache lacks this one for this processor."""
    if hasattr(kernel, "_cache"):
        index, code = kernel._cache._cache_file._load_index(), kernel.targetctx.codegen()
        if code.magic_tuple() not in (key[1] for key in index):
            _announce()


@cache
def _announce() -> None:
    if parent_process() is None:
        once = f"for this command alone, since no folder can keep it (set {CACHE} to one)"
        once = "once on this machine" if KEPT else once
        say(f"compiling numerical code, {once}: up to {COMPILE_S} s ...")
