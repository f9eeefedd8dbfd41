"""Whether there is a GPU, and a module that stands in for CuPy where there is none: numpy behind
arrays as strict as a device's.

An array lives on the "device" and mixes with others there and with scalars alone: what would meet a
numpy array, or turn silently into one, raises as CuPy does. Only functions that CuPy has under the
same name exist.
"""

from __future__ import annotations

from types import ModuleType, SimpleNamespace

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from handbench.radar.imaging.device import array_module
from handbench.support.errors import HandbenchError

# Each was looked up in CuPy 14; add a name only after doing so.
FUNCTIONS = (
    "arange",
    "ascontiguousarray",
    "clip",
    "concatenate",
    "cos",
    "empty",
    "matmul",
    "ones",
    "rint",
    "sin",
    "sqrt",
    "stack",
    "take_along_axis",
    "zeros",
)
METHODS = ("argmax", "astype", "conj", "max", "reshape", "sum", "swapaxes", "transpose", "view")
ATTRIBUTES = ("T", "dtype", "imag", "nbytes", "ndim", "real", "shape", "size")


def has_gpu() -> bool:
    """Whether CuPy and a CUDA device are there."""
    try:
        array_module("cuda")
    except HandbenchError:
        return False
    return True


class DeviceArray(NDArrayOperatorsMixin):
    """An array on the stand-in's device."""

    def __init__(self, inner: np.ndarray) -> None:
        self._inner = inner

    def get(self) -> np.ndarray:
        """A copy in the processor's memory."""
        return self._inner.copy()

    def __array__(self, *_args, **_kwargs):
        raise TypeError("Implicit conversion to a NumPy array is not allowed; use .get()")

    def __array_ufunc__(self, ufunc, method, *inputs, out=(), **options):
        if method != "__call__":
            raise TypeError(f"ufunc.{method} is not used on devices")
        if out:
            options["out"] = tuple(map(_bare, out))
        return _wrapped(ufunc(*map(_bare, inputs), **options))

    def __getattr__(self, name):
        if name in ATTRIBUTES:
            return _wrapped(getattr(self._inner, name))
        if name in METHODS:
            return lambda *args, **options: _wrapped(
                getattr(self._inner, name)(*_bare(args), **_bare(options))
            )
        raise AttributeError(f"{name}: not among the attributes known to exist in CuPy")

    def __setattr__(self, name, value):
        if name in ("real", "imag"):
            setattr(self._inner, name, _bare(value))
        else:
            super().__setattr__(name, value)

    def __getitem__(self, index):
        return _wrapped(self._inner[_bare(index)])

    def __setitem__(self, index, value):
        self._inner[_bare(index)] = _bare(value)

    def __len__(self):
        return len(self._inner)

    def __iter__(self):
        return map(_wrapped, self._inner)


def _bare(value):
    """What numpy is called with; a host's array never reaches it."""
    if isinstance(value, DeviceArray):
        return value._inner
    if isinstance(value, np.ndarray):
        raise TypeError("Unsupported type <class 'numpy.ndarray'>")
    if isinstance(value, tuple | list):
        return type(value)(map(_bare, value))
    return {key: _bare(item) for key, item in value.items()} if isinstance(value, dict) else value


def _wrapped(value):
    return DeviceArray(value) if isinstance(value, np.ndarray | np.generic) else value


def _function(name):
    return lambda *args, **options: _wrapped(getattr(np, name)(*_bare(args), **_bare(options)))


def cupy_stand_in() -> ModuleType:
    """The module, with one device."""
    module = ModuleType("cupy")
    for name in FUNCTIONS:
        setattr(module, name, _function(name))
    module.asarray = lambda value, dtype=None: DeviceArray(
        np.array(getattr(value, "_inner", value), dtype=dtype)
    )
    runtime = SimpleNamespace(
        getDeviceCount=lambda: 1, getDeviceProperties=lambda _: {"name": b"Stand-in"}
    )
    module.cuda = SimpleNamespace(runtime=runtime, Device=lambda: SimpleNamespace(id=0))
    return module
