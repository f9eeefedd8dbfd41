"""Echoes in somebody else's HDF5 file (MATLAB v7.3 is HDF5), described by a `mapping.toml` beside it."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import h5py
import numpy as np
from pydantic import Field, model_validator

from bench.datasets.native import CaptureFile, NativeCapture
from radar.data.arrays import AntennaArray, PlanarScan
from radar.data.capture import RadarCapture, single
from radar.support.config import Config, load
from radar.support.errors import HandbenchError
from radar.support.files import inside, require_file
from radar.support.hdf5 import opened, read

MAPPING = "mapping.toml"
HERTZ = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9}
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
RE_IM = "re_im"  # an axis of two: real and imaginary part
PARTS = (("real", "imag"), ("r", "i"))  # names of a complex number's parts: MATLAB's, h5py's
InFile = Annotated[str, Field(min_length=1, max_length=1000)]
SampleAxis = Literal["frame", "frequency", "tx", "rx", "position", "re_im"]


class Samples(Config):
    """Place and form of the echoes in the file. axes: as the program that wrote them counts them; reversed: the file's
    order is the opposite, as MATLAB's is, whose arrays are stored by column. sign: of j2πf·path/c in the exponent of an
    echo."""

    dataset: InFile | None = None
    real: InFile | None = None
    imag: InFile | None = None
    axes: tuple[SampleAxis, ...]
    reversed: bool
    sign: Literal["-", "+"]

    @model_validator(mode="after")
    def _told_once(self) -> "Samples":
        pair = self.real is not None and self.imag is not None
        if (self.dataset is not None) == pair or (self.real is None) != (self.imag is None):
            raise ValueError('give either dataset = "…" or both real = "…" and imag = "…"')
        if len(set(self.axes)) < len(self.axes) or "frequency" not in self.axes:
            raise ValueError('axes name each axis once, and one of them is "frequency"')
        if {"tx", "rx", "position"} & set(self.axes) not in ({"tx", "rx"}, {"position"}):
            raise ValueError('axes hold "tx" and "rx", or "position" of a transceiver that is moved')
        if RE_IM in self.axes and pair:
            raise ValueError('real and imag are two data sets; axes then have no "re_im"')
        return self


class Frequencies(Config):
    """Place of the tones [f] in the file."""

    dataset: InFile
    unit: Literal["Hz", "kHz", "MHz", "GHz"]


class Positions(Config):
    """Place of the antennas' positions [n, 3] (x, y, z) in the file. reversed: as in `Samples`; x: its direction, seen
    from the array looking at the target (ours points to the left)."""

    dataset: InFile
    unit: Literal["m", "cm", "mm"]
    reversed: bool
    x: Literal["left", "right"]


class Mapping(Config):
    """The content of `mapping.toml`; capture: as in a `capture.toml`."""

    version: Literal[1]
    file: InFile
    capture: CaptureFile
    samples: Samples
    frequencies: Frequencies
    tx: Positions | None = None
    rx: Positions | None = None
    position: Positions | None = None

    @model_validator(mode="after")
    def _positions_of_the_axes(self) -> "Mapping":
        for name in ("tx", "rx", "position"):
            if (getattr(self, name) is not None) != (name in self.samples.axes):
                raise ValueError(f'the table [{name}] is there if, and only if, samples.axes name "{name}"')
        return self


@dataclass(frozen=True)
class MappedCapture(NativeCapture):
    """A folder with a `mapping.toml`; mesh, photographs and transform lie there as in a capture folder."""

    @staticmethod
    def fits(folder: Path) -> bool:
        """True if this adapter reads the capture in `folder`."""
        return (folder / MAPPING).is_file()

    @cached_property
    def mapping(self) -> Mapping:
        """Its mapping.toml."""
        return load(Mapping, self.folder / MAPPING, "a mapping of an HDF5 file")

    @property
    def about(self) -> CaptureFile:
        """Its description."""
        return self.mapping.capture

    def echoes(self, frames: int | None = None, calibrated: bool = True) -> RadarCapture:
        """Its first `frames` frames, or all; they are as recorded."""
        told = self.mapping
        path = require_file(inside(self.folder, told.file, MAPPING), "the HDF5 file that mapping.toml names")
        try:
            with opened(path) as file:
                source = _Source(path, file)
                frequencies_hz = source.frequencies_hz(told.frequencies)
                named = [name for name in ("tx", "rx", "position") if name in told.samples.axes]
                places = {name: source.positions_m(name, getattr(told, name)) for name in named}
                counts = {"frequency": len(frequencies_hz)} | {name: len(p) for name, p in places.items()}
                samples = source.samples(told.samples, counts)[:frames]
            if "position" in places:
                return RadarCapture(samples, frequencies_hz, PlanarScan(places["position"]))
            return RadarCapture(samples, frequencies_hz, AntennaArray(places["tx"], places["rx"]))
        except HandbenchError as error:
            message = str(error)
            raise HandbenchError(message if message.startswith(str(path)) else f"{path}: {message}") from None
        except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise HandbenchError(f"{path}: is not a readable HDF5 file ({reason}); copy it again") from error


@dataclass(frozen=True)
class _Source:
    """An open HDF5 file."""

    path: Path
    file: h5py.File

    def frequencies_hz(self, told: Frequencies) -> np.ndarray:
        """[f]; MATLAB's vectors have an axis of one more."""
        values = self._real(told.dataset)
        if values.size == 0 or values.size != max(values.shape, default=0):
            raise self._wrong(told.dataset, values.shape, "[frequency]")
        with np.errstate(over="ignore"):  # what is infinite then is refused with the capture
            return values.reshape(-1) * HERTZ[told.unit]

    def positions_m(self, name: str, told: Positions) -> np.ndarray:
        """[n, 3] in our frame."""
        values = self._real(told.dataset)
        values = values.T if told.reversed else values
        if values.ndim != 2 or values.shape[1] != 3:
            stored = "[3, n] as stored, for it is reversed" if told.reversed else "[n, 3]"
            raise self._wrong(told.dataset, values.T.shape if told.reversed else values.shape, f"{stored} of {name}")
        return values * METRES[told.unit] * ([-1, 1, 1] if told.x == "right" else 1)

    def samples(self, told: Samples, counts: dict[str, int]) -> np.ndarray:
        """complex64 [frame, frequency, tx, rx] or [frame, frequency, position] with our sign."""
        axes = told.axes[::-1] if told.reversed else told.axes
        counts = {**counts, RE_IM: 2}
        parts = [self._read(name) for name in (told.dataset, told.real, told.imag) if name is not None]
        for name, values in zip((told.dataset or told.real, told.imag), parts, strict=False):
            fits = values.ndim == len(axes) and all(
                values.shape[i] == counts.get(axis, values.shape[i]) for i, axis in enumerate(axes)
            )
            if not fits or values.size == 0:
                expected = ", ".join(f"{axis} {counts[axis]}" if axis in counts else axis for axis in axes)
                raise self._wrong(str(name), values.shape, f"[{expected}] as stored")
        with np.errstate(invalid="ignore", over="ignore"):  # what is infinite is refused with the capture
            values = self._complex(told, parts, axes)
        axes = tuple(axis for axis in axes if axis != RE_IM)
        order = [axis for axis in ("frame", "frequency", "tx", "rx", "position") if axis in axes]
        values = values.transpose([axes.index(axis) for axis in order])
        values = values if "frame" in axes else values[None]
        return single(values.conj() if told.sign == "+" else values)

    def _complex(self, told: Samples, parts: list[np.ndarray], axes: tuple[str, ...]) -> np.ndarray:
        if len(parts) == 2:
            return self._require_real(str(told.real), parts[0]) + 1j * self._require_real(str(told.imag), parts[1])
        [values] = parts
        if RE_IM in axes:
            real, imag = np.moveaxis(self._require_real(str(told.dataset), values), axes.index(RE_IM), 0)
            return real + 1j * imag
        for real, imag in PARTS:
            if values.dtype.names and set(values.dtype.names) == {real, imag}:
                return values[real] + 1j * values[imag]
        if values.dtype.kind != "c":
            raise HandbenchError(
                f"{self.path}: '{told.dataset}' holds {values.dtype}; expected complex numbers: name the data sets of "
                'both parts (real, imag) or the axis "re_im"'
            )
        return values

    def _real(self, name: str) -> np.ndarray:
        return self._require_real(name, self._read(name)).astype(np.float64)

    def _require_real(self, name: str, values: np.ndarray) -> np.ndarray:
        if values.dtype.kind not in "iuf":
            raise HandbenchError(f"{self.path}: '{name}' holds {values.dtype}; expected real numbers")
        return values

    def _read(self, name: str) -> np.ndarray:
        """A data set whole; refuses what leads out of the file, what is no numbers, and what is too large."""
        try:
            return read(self.file, name, self.path)
        except ValueError as error:
            raise HandbenchError(f"{self.path}: {error}; it has {self._names()}") from None

    def _names(self) -> str:
        """The first data sets of the file, among its first things."""
        names: dict[str, int] = {}
        self.file.visit(lambda name: names.setdefault(name, len(names)) > 100 or None)
        found = [name[:200] for name in names if isinstance(self.file[name], h5py.Dataset)]
        return ", ".join(found[:12]) or "no data sets"

    def _wrong(self, name: str, shape: tuple[int, ...], expected: str) -> HandbenchError:
        return HandbenchError(f"{self.path}: '{name}' has shape {shape}; expected {expected}; mend mapping.toml")
