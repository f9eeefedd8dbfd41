"""Where imaging runs: on the processor's cores (`cpu`), or by array code on a CUDA device (`cuda`: CuPy) or, to test that
code anywhere, in numpy (`numpy`).

The choice holds for the whole process and is kept in HANDBENCH_DEVICE, so that every worker thread sees it and every
child process inherits it. The command line sets it from --device.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from radar.errors import HandbenchError

SETTING = "HANDBENCH_DEVICE"
DEVICES = ("cpu", "cuda", "numpy")
BLOCK_BYTES = 1 << 28  # of intermediate arrays at once: long enough work for a device, and little of its memory

Array = Any  # a numpy.ndarray or a cupy.ndarray


def chosen() -> str:
    """The device that imaging runs on: HANDBENCH_DEVICE, or the processor."""
    name = os.environ.get(SETTING, "") or "cpu"
    if name not in DEVICES:
        raise HandbenchError(f"{SETTING}: is '{name}'; expected {', '.join(DEVICES)}, or nothing")
    return name


@contextmanager
def use_device(name: str | None) -> Iterator[None]:
    """Image on this device (None: the one already chosen) until the block ends. A device that is not there, or whose
    memory runs out, is a HandbenchError. The setting is the process's: two threads cannot choose two devices."""
    before = os.environ.get(SETTING)
    try:
        os.environ[SETTING] = name or chosen()
        if chosen() != "cpu":
            array_module()
        yield
    except MemoryError as error:
        if chosen() == "cpu":
            raise
        raise HandbenchError(
            f"--device {chosen()}: out of memory ({error}); close what else uses it, or leave the option out"
        ) from error
    finally:
        if before is None:
            os.environ.pop(SETTING, None)
        else:
            os.environ[SETTING] = before


def array_module(device: str | None = None) -> ModuleType:
    """numpy or cupy, for the device given or chosen; refuses what is not there."""
    device = device or chosen()
    if device == "numpy":
        return np
    if device != "cuda":
        raise HandbenchError(f"device: '{device}' runs no array code; expected cuda or numpy")
    try:
        import cupy
    except ImportError as error:
        hint = "pip install 'handbench[gpu]'" if isinstance(error, ModuleNotFoundError) else f"it does not load: {error}"
        raise HandbenchError(f"--device cuda: CuPy is not installed; {hint}, or leave the option out") from None
    try:
        if cupy.cuda.runtime.getDeviceCount() > 0:
            return cupy
        reason = "it counts none"
    except RuntimeError as error:  # the base of CuPy's errors: no driver, one that is too old, no device
        reason = str(error)
    raise HandbenchError(f"--device cuda: no CUDA device found ({reason}); leave the option out to use the processor")


def to_host(array: Array) -> np.ndarray:
    """A device's array in the processor's memory."""
    return array if isinstance(array, np.ndarray) else array.get()


def describe(device: str | None = None) -> str:
    """The device given or chosen, in words for a result: cpu, or cuda with the name of the card."""
    device = device or chosen()
    if device != "cuda":
        return device
    cuda = array_module(device).cuda
    name = cuda.runtime.getDeviceProperties(cuda.Device().id)["name"]
    return f"cuda: {name.decode() if isinstance(name, bytes) else name}"
