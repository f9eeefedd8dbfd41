"""Captures with echoes in an HDF5 or MATLAB file of another program. A `mapping.toml` next to the
file says which data sets of the file contain what, and how they are laid out."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from handbench.bench.datasets.native import CaptureFile, NativeCapture
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.recording import Recording, join_arrays
from handbench.support.config import Config, load
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, require_file
from handbench.support.hdf5 import local_item, open_hdf5, read
from handbench.support.matlab import read_matlab

MAPPING = "mapping.toml"
RE_IM = "re_im"  # an axis of two: real and imaginary part
CHANNELS = ({"tx", "rx"}, {"pair"}, {"position"})  # that samples have axes of, and …
TABLES = ({"tx", "rx"}, {"tx", "rx", "pairs"}, {"position"})  # … the tables that there are then
InFile = Annotated[str, Field(min_length=1, max_length=1000)]
Axis = Literal["frame", "sweep", "frequency", "tx", "rx", "pair", "position", "re_im"]
UNITS = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9, "m": 1.0, "cm": 1e-2, "mm": 1e-3}
PARTS = (("real", "imag"), ("r", "i"))  # names of a complex number's parts: MATLAB's, h5py's
ORDER = ("frame", "sweep", "frequency", "tx", "rx", "pair", "position")  # of a recording's axes

Read = Callable[[str], np.ndarray]  # from a name to the whole data set as it is stored


class GainsMapping(Config):
    """Names and layout of the data sets with the gains of the channels, by which samples are
    divided; the base of the description of any complex numbers in another program's file.

    dataset: name of one data set of complex numbers; or real and imag: names of two data sets.
    axes: in the order of the program that wrote the file. reversed: True if the file stores the
    axes in the opposite order, as MATLAB's files do.
    """

    dataset: InFile | None = None
    real: InFile | None = None
    imag: InFile | None = None
    axes: tuple[Axis, ...]
    reversed: bool

    @property
    def datasets(self) -> list[str]:
        """Names of the data sets: one of complex numbers, or two of the real and imaginary
        parts."""
        return [name for name in (self.dataset, self.real, self.imag) if name is not None]

    @property
    def channels(self) -> set[str]:
        """The axes that count channels: "tx" and "rx", "pair", or "position"."""
        return {str(axis) for axis in self.axes} - {"frame", "sweep", "frequency", RE_IM}

    @model_validator(mode="after")
    def _require_named_once(self) -> "GainsMapping":
        pair = self.real is not None and self.imag is not None
        if (self.dataset is not None) == pair or (self.real is None) != (self.imag is None):
            raise ValueError('give either dataset = "…", or both real = "…" and imag = "…"')
        if len(set(self.axes)) < len(self.axes):
            raise ValueError("an axis is named twice; name each axis once")
        if self.channels not in CHANNELS:
            raise ValueError(
                'the axes must include "tx" and "rx", or "pair", or "position" (for one '
                "transceiver that is moved)"
            )
        if RE_IM in self.axes and pair:
            raise ValueError(
                'real and imag are two data sets, so the axes must not include "re_im"; remove it'
            )
        return self


class SamplesMapping(GainsMapping):
    """Names and layout of the data sets with the echoes in another program's file.

    sign: sign of j2πf·path/v in the exponent of an echo with wave speed v, and in that of the
    gains. sweeps: whether the sweeps of a frame are averaged ("mean") or each becomes a frame
    ("frames").
    """

    sign: Literal["-", "+"]
    sweeps: Literal["mean", "frames"] | None = None

    @model_validator(mode="after")
    def _all_axes(self) -> "SamplesMapping":
        if "frequency" not in self.axes:
            raise ValueError('the axes do not include "frequency"; add it')
        if (self.sweeps is not None) != ("sweep" in self.axes):
            raise ValueError(
                'the axis "sweep" and the key sweeps (= "mean" or "frames") need each other; give '
                "both or none"
            )
        return self


class FrequenciesMapping(Config):
    """Name and unit of the data set with the frequencies [f] in another program's file."""

    dataset: InFile
    unit: Literal["Hz", "kHz", "MHz", "GHz"]


class PositionsMapping(Config):
    """Name, unit and layout of a data set with antenna positions [n, 3] (x, y, z) in another
    program's file.

    reversed: True if the file stores the axes in the opposite order, as MATLAB's files do. x:
    direction of the file's x axis for somebody at the array who looks at the target; handbench's x
    axis points left.
    """

    dataset: InFile
    unit: Literal["m", "cm", "mm"]
    reversed: bool
    x: Literal["left", "right"]


class PairsMapping(Config):
    """Name and layout of the data set with the measured pairs of antennas [n, 2] (transmitter,
    receiver) in another program's file.

    reversed: True if the file stores the axes in the opposite order, as MATLAB's files do. first:
    number of the first antenna, 0 or (in MATLAB) 1.
    """

    dataset: InFile
    reversed: bool
    first: Literal[0, 1]


class ArrayMapping(Config):
    """Names and layouts of all data sets of one antenna array: echoes, positions of the antennas,
    measured pairs, and gains."""

    samples: SamplesMapping
    tx: PositionsMapping | None = None
    rx: PositionsMapping | None = None
    position: PositionsMapping | None = None
    pairs: PairsMapping | None = None
    gains: GainsMapping | None = None

    @property
    def datasets(self) -> list[str]:
        """Names of all data sets that belong to this array."""
        tables = [self.tx, self.rx, self.position, self.pairs]
        complexes = [self.samples, self.gains]
        return [t.dataset for t in tables if t] + [
            name for c in complexes if c for name in c.datasets
        ]

    @model_validator(mode="after")
    def _tables_of_the_axes(self) -> "ArrayMapping":
        needed = TABLES[CHANNELS.index(self.samples.channels)]
        for name in ("tx", "rx", "position", "pairs"):
            if (getattr(self, name) is not None) != (name in needed):
                axis = name.removesuffix("s") + ('" or "pair' if name in ("tx", "rx") else "")
                raise ValueError(
                    f'the table [{name}] and the axis "{axis}" of samples.axes need each other; '
                    "give both or none"
                )
        if self.gains and {*self.gains.axes} - {"frequency", RE_IM} != self.samples.channels:
            raise ValueError(
                'gains.axes must have the same antenna axes as samples.axes, and "frequency" if '
                "the gains differ by tone"
            )
        return self


class Mapping(ArrayMapping):
    """The content of a `mapping.toml`.

    file: the HDF5 or MATLAB file. capture: description of the capture, with the keys of a
    `capture.toml`. array: further antenna arrays, whose receivers record only their own
    transmitters.
    """

    version: Literal[1]
    file: InFile
    capture: CaptureFile
    frequencies: FrequenciesMapping
    wave_speed_m_s: float = SPEED_OF_LIGHT_M_S
    licence: str = ""
    array: tuple[ArrayMapping, ...] = ()


@dataclass(frozen=True)
class MappedCapture(NativeCapture):
    """A capture in a folder with a `mapping.toml`, which describes an HDF5 or MATLAB file with the
    echoes. Mesh, photographs and transform are stored as in handbench's own capture folders."""

    @staticmethod
    def fits(folder: Path) -> bool:
        """Tell whether `folder` has a `mapping.toml`, so that this class can read it."""
        return (folder / MAPPING).is_file()

    @cached_property
    def mapping(self) -> Mapping:
        """The content of the capture's mapping.toml."""
        return load(Mapping, self.folder / MAPPING, "a mapping of an HDF5 or MATLAB file")

    @property
    def about(self) -> CaptureFile:
        """The description of the capture, from its mapping.toml."""
        return self.mapping.capture

    def echoes(self, frames: int | None = None, calibrated: bool = True) -> RadarCapture:
        """Read the echoes of the first `frames` frames (None: all).

        Gains in the mapping are always applied. calibrated: apply the capture's corrections
        (`corrections.json`), too, and print a line about them. Raises HandbenchError if the file
        does not agree with its mapping.
        """
        mapping, arrays = self.mapping, (self.mapping, *self.mapping.array)
        path = require_file(
            inside(self.folder, mapping.file, MAPPING),
            "the HDF5 or MATLAB file that mapping.toml names",
        )
        try:
            with _reader(
                path,
                {
                    mapping.frequencies.dataset,
                    *(name for array in arrays for name in array.datasets),
                },
            ) as of:
                capture = join_arrays(
                    [_recording(of, mapping, array).capture() for array in arrays]
                )
            capture = replace(capture, samples=capture.samples[:frames])
            return self._corrected(capture) if calibrated else capture
        except HandbenchError as error:
            raise HandbenchError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
        except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise HandbenchError(
                f"{path}: is not a readable HDF5 or MATLAB file ({reason}); copy it again"
            ) from error


@contextmanager
def _reader(path: Path, wanted: set[str]) -> Iterator[Read]:
    """Open an HDF5 or MATLAB file, and yield a function that reads one of its data sets by name.

    wanted: names of the data sets that the file must have. Raises HandbenchError with the names of
    those that are missing.
    """
    import h5py

    matlab = not h5py.is_hdf5(path)
    source: AbstractContextManager[Any] = (
        nullcontext(read_matlab(path)) if matlab else open_hdf5(path)
    )
    with source as file:
        found = file.get if matlab else partial(local_item, file)
        if lacking := [name for name in sorted(wanted) if found(name) is None]:
            names: dict[str, int] = dict.fromkeys(file, 0) if matlab else {}
            if not matlab:
                file.visit(lambda name: names.setdefault(name, len(names)) > 100 or None)
            there = [name[:200] for name in names if matlab or isinstance(file[name], h5py.Dataset)]
            lacks = ", ".join(f"'{name[:200]}'" for name in lacking)
            raise HandbenchError(
                f"has no {lacks}; the file has {', '.join(there[:12]) or 'no data sets'}"
            )
        yield file.__getitem__ if matlab else partial(read, file, path=path)


def _recording(of: Read, mapping: Mapping, array: ArrayMapping) -> Recording:
    """Read the echoes, antenna positions, measured pairs and gains of one array. of: function that
    reads a data set of the file by name."""
    frequencies_hz = _real(of, mapping.frequencies.dataset)
    if frequencies_hz.size == 0 or frequencies_hz.size != max(frequencies_hz.shape, default=0):
        # MATLAB's have an axis of one more
        raise _wrong(mapping.frequencies.dataset, frequencies_hz, "[frequency]")
    with np.errstate(over="ignore"):  # what is infinite then is refused with the capture
        frequencies_hz = frequencies_hz.reshape(-1) * UNITS[mapping.frequencies.unit]
    given = {
        name: at for name in ("tx", "rx", "position") if (at := getattr(array, name)) is not None
    }
    places = {name: _table(of, at, 3, f"of {name}") * UNITS[at.unit] for name, at in given.items()}
    places_m = {
        f"{name}_m": p * ([-1, 1, 1] if given[name].x == "right" else 1)
        for name, p in places.items()
    }
    pairs = (
        None if array.pairs is None else _table(of, array.pairs, 2, "of pairs") - array.pairs.first
    )
    counts = {name: len(place) for name, place in places.items()} | {
        "frequency": len(frequencies_hz),
        RE_IM: 2,
    }
    counts |= {} if pairs is None else {"pair": len(pairs)}
    samples = _complex(of, array.samples, counts)
    for place, axis in enumerate(ORDER[:2]):
        samples = samples if axis in array.samples.axes else np.expand_dims(samples, place)
    gains = None if array.gains is None else _complex(of, array.gains, counts)
    if array.samples.sign == "+":
        samples, gains = samples.conj(), None if gains is None else gains.conj()
    about = {
        "wave_speed_m_s": mapping.wave_speed_m_s,
        "source": mapping.capture.source or "",
        "licence": mapping.licence,
    }
    return Recording(
        samples, frequencies_hz, places_m, pairs, gains, array.samples.sweeps or "mean", about
    )


def _table(of: Read, entry: PositionsMapping | PairsMapping, columns: int, what: str) -> np.ndarray:
    """Read a data set of real numbers [n, columns]. of: function that reads a data set by name;
    entry: its name and layout; what: description of its content for the message if its shape is
    wrong."""
    stored = _real(of, entry.dataset)
    if stored.ndim != 2 or stored.shape[0 if entry.reversed else 1] != columns:
        expected = (
            f"[{columns}, n], because reversed = true," if entry.reversed else f"[n, {columns}]"
        )
        raise _wrong(entry.dataset, stored, f"{expected} {what}")
    return stored.T if entry.reversed else stored


def _complex(of: Read, entry: GainsMapping, counts: dict[str, int]) -> np.ndarray:
    """Read an array of complex numbers. of: function that reads a data set by name; entry: names
    and layout of the data sets; counts: expected length of each axis, where known.

    The axes of the result are in handbench's order (frame, sweep, frequency, tx, rx, pair,
    position), without those that the file lacks. Raises HandbenchError if an axis has another
    length.
    """
    axes: tuple[str, ...] = entry.axes[::-1] if entry.reversed else entry.axes
    parts = {name: of(name) for name in entry.datasets}
    if entry.reversed:  # MATLAB has no last axes of length one
        parts = {
            name: values.reshape((1,) * (len(axes) - values.ndim) + values.shape)
            for name, values in parts.items()
        }
    for name, values in parts.items():
        expected = tuple(
            counts.get(axis, size) for axis, size in zip(axes, values.shape, strict=False)
        )
        if values.ndim != len(axes) or values.shape != expected or values.size == 0:
            known = ", ".join(f"{axis} {counts[axis]}" if axis in counts else axis for axis in axes)
            raise _wrong(name, values, f"[{known}] as stored")
    # what is infinite is refused with the capture
    with np.errstate(invalid="ignore", over="ignore"):
        values = _joined(parts, axes)
    axes = tuple(axis for axis in axes if axis != RE_IM)
    return values.transpose([axes.index(axis) for axis in ORDER if axis in axes])


def _joined(parts: dict[str, np.ndarray], axes: tuple[str, ...]) -> np.ndarray:
    """Combine real and imaginary parts to complex numbers. parts: one or two data sets by name;
    axes: names of their axes in order, where "re_im" is an axis of length two with both parts."""
    if len(parts) == 2 or RE_IM in axes:
        given = [_require_real(name, values) for name, values in parts.items()]
        real, imag = given if len(given) == 2 else np.moveaxis(given[0], axes.index(RE_IM), 0)
        return real + 1j * imag
    [(name, values)] = parts.items()
    for real, imag in PARTS:
        if values.dtype.names and set(values.dtype.names) == {real, imag}:
            return values[real] + 1j * values[imag]
    if values.dtype.kind != "c":
        raise HandbenchError(
            f"'{name}' has values of type {values.dtype}; expected complex numbers; name the data "
            'sets of both parts (real, imag), or the axis "re_im"'
        )
    return values


def _real(of: Read, name: str) -> np.ndarray:
    return _require_real(name, of(name)).astype(np.float64)


def _require_real(name: str, values: np.ndarray) -> np.ndarray:
    if values.dtype.kind not in "iuf":
        raise HandbenchError(f"'{name}' has values of type {values.dtype}; expected real numbers")
    return values


def _wrong(name: str, values: np.ndarray, expected: str) -> HandbenchError:
    return HandbenchError(
        f"'{name}' has shape {values.shape}; expected {expected}; correct mapping.toml"
    )
