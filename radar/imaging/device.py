"""The device that computes images: the processor's cores (cpu), a CUDA device by CuPy (cuda), or
numpy (numpy), which runs the code for CUDA devices without one, for tests.

Phases, distances and maxima are array code for either array module (argument `xp`: numpy or cupy).
The device is a setting of the whole process, in the environment variable HANDBENCH_DEVICE: worker
threads see it and child processes inherit it. The command line sets it from --device.
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
# size of intermediate arrays: enough work for a device, and a small part of its memory
BLOCK_BYTES = 1 << 28

Array = Any  # a numpy.ndarray or a cupy.ndarray


def current_device() -> str:
    """Return the name of the device of imaging: cpu, cuda or numpy, from HANDBENCH_DEVICE (unset:
    cpu). Raises HandbenchError for another name."""
    name = os.environ.get(SETTING, "") or "cpu"
    if name not in DEVICES:
        raise HandbenchError(
            f"{SETTING}: is '{name}'; set it to {' or '.join(DEVICES)}, or unset it"
        )
    return name


@contextmanager
def use_device(name: str | None) -> Iterator[None]:
    """Image on this device (cpu, cuda, numpy; None: the current one) until the `with` block ends.
    All threads share the setting.

    Raises HandbenchError for a device that cannot compute, or whose memory runs out.
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
            f"--device {current_device()}: the memory of the device is full ({error}); close "
            "other programs that use it, or leave --device out"
        ) from error
    finally:
        os.environ.pop(SETTING, None)
        if before is not None:
            os.environ[SETTING] = before


def array_module(device: str | None = None) -> ModuleType:
    """Return the array module in which a device (None: the current one) computes: numpy, or cupy
    for cuda. Raises HandbenchError if CuPy is not installed or finds no CUDA device, and for cpu,
    which runs compiled code instead."""
    device = device or current_device()
    if device == "numpy":
        return np
    if device != "cuda":
        raise HandbenchError(f"device: '{device}' cannot run array code; expected cuda or numpy")
    try:
        import cupy
    except ImportError as error:
        found = "is not installed" if error.name == "cupy" else f"does not load ({error})"
        raise HandbenchError(
            f"--device cuda: needs CuPy, which {found}; run pip install 'handbench[gpu]', or "
            "leave --device out"
        ) from error
    try:
        count, reason = cupy.cuda.runtime.getDeviceCount(), "the NVIDIA driver reports none"
    except (
        RuntimeError
    ) as error:  # the base of CuPy's errors: no driver, too old a driver, no device
        count, reason = 0, str(error)
    if count == 0:
        raise HandbenchError(
            f"--device cuda: no CUDA device was found ({reason}); leave --device out"
        )
    return cupy


def _try(xp: ModuleType) -> None:
    """Compute a cosine and a matrix product with an array module, so that a missing compiler or
    cuBLAS is found before a run. Raises HandbenchError if that fails."""
    try:
        to_host(xp.matmul(xp.cos(xp.zeros((2, 2), np.float32)), xp.ones((2, 2), np.float32)))
    except Exception as error:
        raise HandbenchError(
            f"--device cuda: CuPy finds a device but cannot compute on it ({error}); run pip "
            "install 'handbench[gpu]' for the libraries that it needs, or leave --device out"
        ) from error


def to_host(array: Array) -> np.ndarray:
    """Copy a device's array to the processor's memory."""
    return array if isinstance(array, np.ndarray) else array.get()


def describe(device: str | None = None) -> str:
    """Return the name of a device (None: the current one) that results record: cpu, numpy, or cuda
    with the name of the graphics card."""
    device = device or current_device()
    if device != "cuda":
        return device
    cuda = array_module(device).cuda
    name = cuda.runtime.getDeviceProperties(cuda.Device().id)["name"]
    return f"cuda: {name.decode() if isinstance(name, bytes) else name}"


def cis(xp: ModuleType, turns: Array) -> Array:
    """Compute exp(j2π·turns) as complex64, in numpy or cupy (`xp`). Whole turns are removed in the
    precision of `turns`: float64, or float32 for a few turns."""
    angle = (turns - xp.rint(turns)).astype(np.float32, copy=False)
    angle *= np.float32(2 * np.pi)
    wave = xp.empty(angle.shape, np.complex64)
    wave.real = xp.cos(angle)
    wave.imag = xp.sin(angle)
    return wave


def distances(
    xp: ModuleType, points_m: Sequence[Array] | Array, antennas_m: Sequence[Array] | Array
) -> Array:
    """Compute the distances |p − a| in float64 with the array module `xp` (numpy or cupy). points_m
    and antennas_m: three coordinate arrays each (x, y, z), in metres, that broadcast, or arrays
    [3, …] of these."""
    x, y, z = ((p - a) ** 2 for p, a in zip(points_m, antennas_m, strict=True))
    return xp.sqrt(x + y + z)


def strongest_voxels(re: Array, im: Array, xp: ModuleType = np) -> tuple[Array, Array]:
    """Find the strongest voxel along z for each pixel of a complex volume O [nz, ny, nx], argmax_z
    |O|, with the array module xp (numpy or cupy): (its index along z [ny, nx], magnitudes |O| of
    the voxel before it, of itself and of the voxel behind it [3, ny, nx], NaN beyond the volume).
    """
    power = re**2 + im**2
    index, last = power.argmax(axis=0), len(power) - 1
    around = xp.stack([index - 1, index, index + 1])
    magnitude = xp.sqrt(xp.take_along_axis(power, xp.clip(around, 0, last), axis=0))
    magnitude[(around < 0) | (around > last)] = np.nan
    return index, magnitude
