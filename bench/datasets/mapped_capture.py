"""Echoes in somebody else's HDF5 or MATLAB file, read as the `mapping.toml` beside it says."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import h5py
import numpy as np

from bench.datasets.mapping import MAPPING, RE_IM, Array, Frequencies, Gains, Mapping, Pairs, Positions
from bench.datasets.native import CaptureFile, NativeCapture
from radar.data.capture import RadarCapture
from radar.data.recording import SWEEPS, Recording, joined
from radar.support.config import load
from radar.support.errors import HandbenchError
from radar.support.files import inside, require_file
from radar.support.hdf5 import of_its_own, opened, read
from radar.support.matlab import is_matlab, read_matlab

HERTZ = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9}
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
PARTS = (("real", "imag"), ("r", "i"))  # names of a complex number's parts: MATLAB's, h5py's
ORDER = ("frame", "sweep", "frequency", "tx", "rx", "pair", "position")  # of a recording's axes


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
        return load(Mapping, self.folder / MAPPING, "a mapping of an HDF5 or MATLAB file")

    @property
    def about(self) -> CaptureFile:
        """Its description."""
        return self.mapping.capture

    def echoes(self, frames: int | None = None, calibrated: bool = True) -> RadarCapture:
        """Its first `frames` frames, or all; they are as recorded."""
        told = self.mapping
        path = require_file(inside(self.folder, told.file, MAPPING), "the HDF5 or MATLAB file that mapping.toml names")
        arrays = (told, *told.array)
        try:
            with _reader(path, {told.frequencies.dataset, *(name for array in arrays for name in array.datasets)}) as r:
                source = _Source(path, r)
                capture = joined([source.recording(told, array).capture() for array in arrays])
            return replace(capture, samples=capture.samples[:frames])
        except HandbenchError as error:
            message = str(error)
            raise HandbenchError(message if message.startswith(str(path)) else f"{path}: {message}") from None
        except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise HandbenchError(f"{path}: is not a readable HDF5 or MATLAB file ({reason}); copy it again") from error


@contextmanager
def _reader(path: Path, wanted: Iterable[str]) -> Iterator[Callable[[str], np.ndarray]]:
    """A function from a name to the whole data set; refuses a file that lacks some of those wanted, naming all."""
    if is_matlab(path):
        arrays = read_matlab(path)
        _require(path, [name for name in wanted if name not in arrays], list(arrays))
        yield arrays.__getitem__
        return
    with opened(path) as file:
        lacking = [name for name in wanted if not _has(file, name)]
        names: dict[str, int] = {}
        if lacking:
            file.visit(lambda name: names.setdefault(name, len(names)) > 100 or None)
        _require(path, lacking, [name for name in names if isinstance(file[name], h5py.Dataset)])
        yield partial(read, file, path=path)


def _has(file: h5py.File, name: str) -> bool:
    try:
        return of_its_own(file, name) is not None
    except ValueError:
        return False


def _require(path: Path, lacking: list[str], there: list[str]) -> None:
    if lacking:
        names = ", ".join(f"'{name[:200]}'" for name in sorted(lacking))
        known = ", ".join(name[:200] for name in there[:12]) or "no data sets"
        raise HandbenchError(f"{path}: has no {names} of its own; it has {known}")


@dataclass(frozen=True)
class _Source:
    """An open file, of which `read` gives data sets by name as they are stored."""

    path: Path
    read: Callable[[str], np.ndarray]

    def recording(self, told: Mapping, array: Array) -> Recording:
        """One of the arrays that the mapping tells of."""
        frequencies_hz = self._frequencies_hz(told.frequencies)
        given = {name: at for name in ("tx", "rx", "position") if (at := getattr(array, name)) is not None}
        places_m = {f"{name}_m": self._positions_m(name, at) for name, at in given.items()}
        pairs = None if array.pairs is None else self._pairs(array.pairs)
        counts = {name.removesuffix("_m"): len(places) for name, places in places_m.items()}
        counts |= {"frequency": len(frequencies_hz), "pair": 0 if pairs is None else len(pairs), RE_IM: 2}
        samples = self._complex(array.samples, counts)
        for place, axis in enumerate(ORDER[:2]):
            samples = samples if axis in array.samples.axes else np.expand_dims(samples, place)
        gains = None if array.gains is None else self._complex(array.gains, counts)
        if array.samples.sign == "+":
            samples, gains = samples.conj(), None if gains is None else gains.conj()
        about = {"wave_speed_m_s": told.wave_speed_m_s, "source": told.capture.source or "", "licence": told.licence}
        return Recording(samples, frequencies_hz, places_m, pairs, gains, array.samples.sweeps or SWEEPS[0], about)

    def _frequencies_hz(self, told: Frequencies) -> np.ndarray:
        """[f]; MATLAB's vectors have an axis of one more."""
        values = self._real(told.dataset)
        if values.size == 0 or values.size != max(values.shape, default=0):
            raise self._wrong(told.dataset, values.shape, "[frequency]")
        with np.errstate(over="ignore"):  # what is infinite then is refused with the capture
            return values.reshape(-1) * HERTZ[told.unit]

    def _positions_m(self, name: str, told: Positions) -> np.ndarray:
        """[n, 3] in our frame."""
        values = self._table(told, 3, f"of {name}")
        return values * METRES[told.unit] * ([-1, 1, 1] if told.x == "right" else 1)

    def _pairs(self, told: Pairs) -> np.ndarray:
        """[n, 2], counted from 0."""
        return self._table(told, 2, "of pairs") - told.first

    def _table(self, told: Positions | Pairs, columns: int, what: str) -> np.ndarray:
        stored = self._real(told.dataset)
        values = stored.T if told.reversed else stored
        if values.ndim != 2 or values.shape[1] != columns:
            expected = f"[{columns}, n] as stored, for it is reversed" if told.reversed else f"[n, {columns}]"
            raise self._wrong(told.dataset, stored.shape, f"{expected} {what}")
        return values

    def _complex(self, told: Gains, counts: dict[str, int]) -> np.ndarray:
        """Complex numbers whose axes are in ORDER, as far as they are there."""
        axes = told.axes[::-1] if told.reversed else told.axes
        parts = [self.read(name) for name in told.datasets]
        for name, values in zip(told.datasets, parts, strict=True):
            expected = [counts.get(axis, 0) for axis in axes]
            fits = values.ndim == len(axes) and all(e in (0, n) for e, n in zip(expected, values.shape, strict=True))
            if not fits or values.size == 0:
                known = ", ".join(f"{axis} {counts[axis]}" if axis in counts else axis for axis in axes)
                raise self._wrong(name, values.shape, f"[{known}] as stored")
        with np.errstate(invalid="ignore", over="ignore"):  # what is infinite is refused with the capture
            values = self._joined(told, parts, axes)
        axes = tuple(axis for axis in axes if axis != RE_IM)
        return values.transpose([axes.index(axis) for axis in ORDER if axis in axes])

    def _joined(self, told: Gains, parts: list[np.ndarray], axes: tuple[str, ...]) -> np.ndarray:
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
        return self._require_real(name, self.read(name)).astype(np.float64)

    def _require_real(self, name: str, values: np.ndarray) -> np.ndarray:
        if values.dtype.kind not in "iuf":
            raise HandbenchError(f"{self.path}: '{name}' holds {values.dtype}; expected real numbers")
        return values

    def _wrong(self, name: str, shape: tuple[int, ...], expected: str) -> HandbenchError:
        return HandbenchError(f"{self.path}: '{name}' has shape {shape}; expected {expected}; mend mapping.toml")
