"""Captures whose echoes are in another program's files. The `mapping.toml` next to them says which
arrays are a capture, and how they are laid out."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from handbench.bench.datasets.named_arrays import read_named
from handbench.bench.datasets.native import MAPPING, CaptureFile, NativeCapture
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture, to_capture
from handbench.support.config import Config, load
from handbench.support.errors import HandbenchError

RE_IM = "re_im"  # an axis of two: real and imaginary part
PLACES = ("position", "y", "x")  # axes that count places of what is moved
ORDER = ("frame", "frequency", *PLACES, "tx", "rx", "pair")  # of axes inside handbench
UNITS = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9, "m": 1.0, "cm": 1e-2, "mm": 1e-3}
MOST_STEPS = 1_000_000

InFile = Annotated[str, Field(min_length=1, max_length=1000)]
Axis = Literal["frame", "frequency", "position", "x", "y", "tx", "rx", "pair", "re_im"]


class Steps(Config):
    """Evenly spaced numbers: `count` from `start` to `stop`."""

    start: float
    stop: float
    count: int = Field(ge=1, le=MOST_STEPS)


Column = InFile | Steps | float | tuple[float, ...]
Read = Callable[[str], np.ndarray]  # from a name to its array


class Numbers(Config):
    """Where numbers are: in a data set, or given by the key `other` instead.

    dataset: its name ("NAME", "FILE:NAME", "FILE.csv", perhaps with an index).
    """

    dataset: InFile | None = None
    other: ClassVar[str]

    @model_validator(mode="after")
    def _one_of_both(self) -> "Numbers":
        if (self.dataset is None) == (getattr(self, self.other) is None):
            raise ValueError(f"give either dataset or {self.other}")
        return self


class ComplexMapping(Numbers):
    """Where complex numbers are, and how they are laid out.

    real, imag: names of two data sets, instead of a complex one. axes: in the order of the program
    that wrote the file. reversed: the file has the opposite order, as MATLAB's files do, since
    MATLAB stores arrays by column.
    """

    real: InFile | None = None
    imag: InFile | None = None
    axes: tuple[Axis, ...]
    reversed: bool
    other = "real"


class SamplesMapping(ComplexMapping):
    """Where the echoes are, and how they are laid out.

    sign: the sign of j2πf·path/v in the exponent of an echo, and of its background.
    """

    sign: Literal["-", "+"]


class MeanBackground(Config):
    """The mean over all positions, or all antennas, as background: what all channels have in
    common."""

    mean: Literal["positions"]


AnyBackground = Annotated[
    Annotated[MeanBackground, Tag("mean")] | Annotated[ComplexMapping, Tag("")],
    Discriminator(lambda given: "mean" * (isinstance(given, dict) and "mean" in given)),
]


class FrequenciesMapping(Numbers):
    """The tones [f]: a data set, or steps."""

    steps: Steps | None = None
    unit: Literal["Hz", "kHz", "MHz", "GHz"]
    other = "steps"


class TableMapping(Numbers):
    """Where a table [n, columns] is.

    columns: instead of a data set, one entry for each: a data set, a number, numbers, or steps.
    reversed: the file has the axes in opposite order, as MATLAB's files do.
    """

    columns: tuple[Column, ...] | None = Field(default=None, min_length=1, max_length=3)
    reversed: bool | None = None
    other = "columns"

    @model_validator(mode="after")
    def _order_of_axes(self) -> "TableMapping":
        if self.dataset is not None and self.reversed is None:
            raise ValueError(
                "reversed is missing; write reversed = true if the file stores the axes in the "
                "opposite order, as MATLAB does, else reversed = false"
            )
        return self


class PositionsMapping(TableMapping):
    """Positions of antennas (x, y, z), or of what is moved; a column that is left out is 0.

    x, y, z: where the axes point for somebody at the array who looks at the target (handbench's x
    points left).
    """

    unit: Literal["m", "cm", "mm"]
    x: Literal["left", "right"]
    y: Literal["up", "down"] = "up"
    z: Literal["away", "back"] = "away"

    @property
    def scale_m(self) -> np.ndarray:
        """The factors [3] from the file's coordinates to handbench's, metres."""
        turned = (self.x == "right", self.y == "down", self.z == "back")
        return UNITS[self.unit] * np.where(turned, -1.0, 1.0)


class PairsMapping(TableMapping):
    """The list of measured pairs [n, 2] (transmitter, receiver). first: the number of the first
    antenna, which is 1 in MATLAB."""

    first: Literal[0, 1]


class Mapping(Config):
    """The content of `mapping.toml`.

    file: the one of names without a file. skip_lines: lines at the beginning of each text file that
    are left out. capture: the keys of a `capture.toml`. position: the places to which one
    transceiver is moved, instead of the antennas tx and rx. background: what is subtracted from the
    samples.
    """

    version: Literal[1]
    file: InFile | None = None
    skip_lines: int = Field(default=0, ge=0, le=100_000)
    wave_speed_m_s: float = SPEED_OF_LIGHT_M_S
    capture: CaptureFile
    samples: SamplesMapping
    frequencies: FrequenciesMapping
    tx: PositionsMapping | None = None
    rx: PositionsMapping | None = None
    position: PositionsMapping | None = None
    pairs: PairsMapping | None = None
    background: AnyBackground | None = None

    @model_validator(mode="after")
    def _tables_of_the_axes(self) -> "Mapping":
        axes, tables = {*self.samples.axes}, {"tx", "rx", "position", "pairs"}
        needed = {"position"} if axes & {*PLACES} else {"tx", "rx"}
        if self.model_fields_set & tables != needed | ({"pairs"} if "pair" in axes else set()):
            raise ValueError(
                'the tables do not fit samples.axes; expected [position] for "position", "x" and '
                '"y", or [tx] and [rx], and [pairs] for "pair"'
            )
        if isinstance(self.background, ComplexMapping) and not {*self.background.axes} <= {
            *axes,
            RE_IM,
        }:
            raise ValueError("background.axes has an axis that samples.axes lacks; remove it")
        return self


@dataclass(frozen=True)
class MappedCapture(NativeCapture):
    """Files of another program that a mapping.toml describes. Mesh, photographs and transform are
    as in a capture folder."""

    @staticmethod
    def fits(folder: Path) -> bool:
        """True if this adapter reads the capture in `folder`."""
        return (folder / MAPPING).is_file()

    @cached_property
    def mapping(self) -> Mapping:
        """The content of its mapping.toml."""
        return load(Mapping, self.folder / MAPPING, "a mapping of other programs' files")

    @property
    def about(self) -> CaptureFile:
        """The description of the capture."""
        return self.mapping.capture

    def _recorded(self) -> RadarCapture:
        """Read the echoes of all frames. Raises HandbenchError if the files do not agree with the
        mapping."""
        mapping = self.mapping

        def read(name: str) -> np.ndarray:
            return read_named(self.folder, name, mapping.file, mapping.skip_lines)

        try:
            return _mapped(read, mapping)
        except HandbenchError as error:
            if str(error).startswith(f"{self.folder}/"):  # about one of the files
                raise
            text = str(error).removeprefix(f"{MAPPING}: ")
            raise HandbenchError(f"{self.folder / MAPPING}: {text}") from None
        except ValueError as error:
            raise HandbenchError(
                f"{self.folder / MAPPING}: its tables have different numbers of rows; give each "
                "table of several rows an axis in samples.axes"
            ) from error


@np.errstate(invalid="ignore", over="ignore")  # what is infinite is refused with the capture
def _mapped(read: Read, mapping: Mapping) -> RadarCapture:
    """Read all arrays of a mapping."""
    tones = mapping.frequencies
    frequencies_hz = UNITS[tones.unit] * _column(read, tones.steps or tones.dataset or "")
    counts = {"frequency": len(frequencies_hz), RE_IM: 2}
    places_m: dict[str, np.ndarray] = {}
    pairs = None
    for name, entry in (("tx", mapping.tx), ("rx", mapping.rx), ("position", mapping.position)):
        if entry is None:
            continue
        if name != "position" or name in mapping.samples.axes:
            table = _table(read, entry, 3)
            counts[name] = len(table)
        else:  # the places of a grid
            x, y, z = _columns(read, entry, 3)
            table = np.stack(np.broadcast_arrays(x, y[:, None], z[:1]), axis=-1).reshape(-1, 3)
            counts |= {"y": len(y), "x": len(x)}
        places_m[f"{name}_m"] = entry.scale_m * table
    if mapping.pairs is not None:
        pairs = _table(read, mapping.pairs, 2) - mapping.pairs.first
        counts["pair"] = len(pairs)
    samples = _complex(read, mapping.samples, counts)
    if isinstance(mapping.background, ComplexMapping):
        samples = samples - _complex(read, mapping.background, counts)
    elif mapping.background is not None:
        of_channels = tuple(range(ORDER.index("frequency") + 1, len(ORDER)))
        samples = samples - np.nanmean(samples, axis=of_channels, keepdims=True)
    if mapping.samples.sign == "+":
        samples = samples.conj()
    channels = [len(table_m) for table_m in places_m.values()] if pairs is None else [len(pairs)]
    return to_capture(
        samples.reshape(*samples.shape[:2], *channels),
        frequencies_hz,
        places_m,
        pairs,
        wave_speed_m_s=mapping.wave_speed_m_s,
        source=mapping.capture.source or "",
    )


def _table(read: Read, entry: TableMapping, columns: int) -> np.ndarray:
    """Read a table of real numbers [n, columns]."""
    if entry.dataset is None:
        return np.stack(np.broadcast_arrays(*_columns(read, entry, columns)), axis=1)
    stored = _real(entry.dataset, read(entry.dataset))
    table = stored.T if entry.reversed else stored
    if table.ndim != 2 or table.shape[1] != columns:
        order = f"[{columns}, n]" if entry.reversed else f"[n, {columns}]"
        raise _wrong(entry.dataset, stored, f"{order} as stored")
    return table


def _columns(read: Read, entry: TableMapping, count: int) -> list[np.ndarray]:
    """Read the columns of a table; those that are left out are 0."""
    return [_column(read, column) for column in (*(entry.columns or ()), 0.0, 0.0, 0.0)[:count]]


def _column(read: Read, column: Column) -> np.ndarray:
    """Read the numbers of a column [n]."""
    if isinstance(column, Steps):
        return np.linspace(column.start, column.stop, column.count)
    values = _real(column, read(column)) if isinstance(column, str) else np.array(column, float)
    return values.reshape(-1)


def _complex(read: Read, entry: ComplexMapping, counts: dict[str, int]) -> np.ndarray:
    """Read complex numbers, with all axes of ORDER; one that the file lacks has length one.
    counts: axis → its expected length, if known."""
    axes = entry.axes[::-1] if entry.reversed else entry.axes
    name = entry.dataset or entry.real or ""
    values = read(name)
    if entry.imag is not None:
        values = _real(name, values) + 1j * _real(entry.imag, read(entry.imag))
    elif values.dtype.names == ("real", "imag"):  # as MATLAB stores them in HDF5
        values = values["real"] + 1j * values["imag"]
    if (shape := _shape(values.shape, axes, counts, entry.reversed)) is None:
        known = ", ".join(f"{axis} {counts.get(axis, '')}".strip() for axis in axes)
        raise _wrong(name, values, f"[{known}] as stored")
    values = values.reshape(shape)
    if RE_IM in axes:
        real, imag = np.moveaxis(_real(name, values), axes.index(RE_IM), 0)
        values, axes = real + 1j * imag, tuple(axis for axis in axes if axis != RE_IM)
    if values.dtype.kind != "c":
        raise HandbenchError(
            f"'{name}' has {_kind(values)}; expected complex numbers; name the data "
            'sets of both parts (real, imag), or the axis "re_im"'
        )
    values = values.transpose([axes.index(axis) for axis in ORDER if axis in axes])
    return np.expand_dims(values, [k for k, axis in enumerate(ORDER) if axis not in axes])


def _shape(
    stored: tuple[int, ...], axes: tuple[str, ...], counts: dict[str, int], reversed: bool
) -> list[int] | None:
    """Compute the shape in which an array has these axes; None if it does not fit.

    stored: as the file has it; axes of length one that have no name are left out. reversed: the
    file is MATLAB's, which leaves out last axes of length one.
    """
    shape = [1] * (reversed * (len(axes) - len(stored))) + [*stored]
    while len(shape) > len(axes) and 1 in shape:
        shape.remove(1)
    expected = [counts.get(axis, size) for axis, size in zip(axes, shape, strict=False)]
    return shape if len(shape) == len(axes) and shape == expected and 0 not in shape else None


def _real(name: str, values: np.ndarray) -> np.ndarray:
    """Return real numbers as double precision; raises HandbenchError for other values."""
    if values.dtype.kind not in "iuf":
        raise HandbenchError(
            f"'{name}' has {_kind(values)}; expected real numbers; name another data set"
        )
    return values.astype(np.float64)


def _kind(values: np.ndarray) -> str:
    return "text" if values.dtype.kind in "SU" else f"values of type {values.dtype}"


def _wrong(name: str, values: np.ndarray, expected: str) -> HandbenchError:
    return HandbenchError(f"'{name}' has shape {values.shape}; expected {expected}")
