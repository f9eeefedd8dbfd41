"""The device on which imaging runs: on the processor's cores (cpu), or as array code on a CUDA
device (cuda, by CuPy) or in numpy (numpy, which tests that code where there is no such device);
phases as array code over either (`xp`).

The choice holds for the whole process. It is kept in HANDBENCH_DEVICE, so that every worker thread
sees it and every child process inherits it; the command line sets it from --device.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from handbench.support.errors import HandbenchError

SETTING = "HANDBENCH_DEVICE"
DEVICES = ("cpu", "cuda", "numpy")
BLOCK_BYTES = (
    1 << 28
)  # of intermediate arrays at once: long enough work for a device, and little of its memory

Array = Any  # a numpy.ndarray or a cupy.ndarray


def current_device() -> str:
    """The device that imaging runs on: HANDBENCH_DEVICE, or the processor."""
    name = os.environ.get(SETTING, "") or "cpu"
    if name not in DEVICES:
        raise HandbenchError(f"{SETTING}: is '{name}'; expected {', '.join(DEVICES)}, or nothing")
    return name


@contextmanager
def use_device(name: str | None) -> Iterator[None]:
    """Image on this device (None: on the one already chosen) until the block ends; two threads
    cannot choose two.

    A device that cannot compute, or whose memory runs out, is a HandbenchError.
    """
    before = os.environ.get(SETTING)
    try:
        os.environ[SETTING] = name or current_device()
        if current_device() != "cpu":
            _try(array_module())
        yield
    except MemoryError as error:
        if current_device() == "cpu":
            raise
        raise HandbenchError(
            f"--device {current_device()}: its memory is full ({error}); close what else uses it, or "
            "leave the option out"
        ) from error
    finally:
        os.environ.pop(SETTING, None)
        if before is not None:
            os.environ[SETTING] = before


def array_module(device: str | None = None) -> ModuleType:
    """numpy or cupy, for the device given or chosen; refuses what is not there."""
    device = device or current_device()
    if device == "numpy":
        return np
    if device != "cuda":
        raise HandbenchError(f"device: '{device}' runs no array code; expected cuda or numpy")
    try:
        import cupy
    except ImportError as error:
        found = "is not installed" if error.name == "cupy" else f"does not load ({error})"
        raise HandbenchError(
            f"--device cuda: CuPy {found}; pip install 'handbench[gpu]', or leave the option out"
        ) from error
    try:
        count, reason = cupy.cuda.runtime.getDeviceCount(), "the driver counts none"
    except (
        RuntimeError
    ) as error:  # the base of CuPy's errors: no driver, too old a driver, no device
        count, reason = 0, str(error)
    if count == 0:
        raise HandbenchError(
            f"--device cuda: no CUDA device found ({reason}); leave the option out"
        )
    return cupy


def _try(xp: ModuleType) -> None:
    """A first sine and a first product: a missing compiler or cuBLAS shows here, not in the middle
    of a run."""
    try:
        to_host(xp.matmul(xp.cos(xp.zeros((2, 2), np.float32)), xp.ones((2, 2), np.float32)))
    except Exception as error:
        raise HandbenchError(
            f"--device cuda: CuPy finds a device but cannot compute ({error}); pip install "
            "'handbench[gpu]' brings the "
            "libraries that it needs, or leave the option out"
        ) from error


def to_host(array: Array) -> np.ndarray:
    """A device's array in the processor's memory."""
    return array if isinstance(array, np.ndarray) else array.get()


def describe(device: str | None = None) -> str:
    """The device given or chosen, in words for a result: cpu, or cuda with the name of the card."""
    device = device or current_device()
    if device != "cuda":
        return device
    cuda = array_module(device).cuda
    name = cuda.runtime.getDeviceProperties(cuda.Device().id)["name"]
    return f"cuda: {name.decode() if isinstance(name, bytes) else name}"


def cis(xp: ModuleType, turns: Array) -> Array:
    """exp(j2π·turns): complex64 of float64 turns, or of float32 ones where a few turns are exact
    enough; whole ones are taken out in the precision in which they come."""
    angle = (turns - xp.rint(turns)).astype(np.float32, copy=False)
    angle *= np.float32(2 * np.pi)
    wave = xp.empty(angle.shape, np.complex64)
    wave.real = xp.cos(angle)
    wave.imag = xp.sin(angle)
    return wave


def distances(xp: ModuleType, points_m: Sequence[Array], antennas_m: Sequence[Array]) -> Array:
    """|p − a| in float64 of points (x, y, z) and antennas (x, y, z), each an array; they are
    broadcast."""
    return xp.sqrt(sum((p - a) ** 2 for p, a in zip(points_m, antennas_m, strict=True)))
