"""The content of a `mapping.toml`: which arrays of another program's files are a capture, and how
they are laid out."""

from itertools import groupby
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from handbench.bench.datasets.native import CaptureFile
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.support.config import Config

RE_IM = "re_im"  # an axis of two: real and imaginary part
PLACES = ("position", "y", "x")  # axes that count places of what is moved
ORDER = ("frame", "sweep", "frequency", *PLACES, "tx", "rx", "pair")  # of axes inside handbench
UNITS = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9, "m": 1.0, "cm": 1e-2, "mm": 1e-3}
MOST_STEPS = 1_000_000

InFile = Annotated[str, Field(min_length=1, max_length=1000)]
Axis = Literal["frame", "sweep", "frequency", "position", "x", "y", "tx", "rx", "pair", "re_im"]


class Steps(Config):
    """Evenly spaced numbers: `count` from `start`, `step` apart or up to `stop`."""

    start: float
    step: float | None = None
    stop: float | None = None
    count: int = Field(ge=1, le=MOST_STEPS)

    @model_validator(mode="after")
    def _one_of_both(self) -> "Steps":
        if (self.step is None) == (self.stop is None):
            raise ValueError("give either step or stop")
        return self

    def values(self) -> np.ndarray:
        """The numbers [count]."""
        if self.stop is not None:
            return np.linspace(self.start, self.stop, self.count)
        return self.start + (self.step or 0.0) * np.arange(self.count)


Column = InFile | Steps | float | tuple[float, ...]


class ComplexMapping(Config):
    """Where complex numbers are, and how they are laid out.
    dataset, or real and imag: names of data sets ("NAME", "FILE:NAME", "FILE.csv", perhaps with an
    index). axes: in the order of the program that wrote the file; an axis that counts several
    things is a list of them, the slowest first; `position` may be the name of several neighbouring
    axes. reversed: the file has the opposite order, as MATLAB's files do, since MATLAB stores
    arrays by column."""

    dataset: InFile | None = None
    real: InFile | None = None
    imag: InFile | None = None
    axes: tuple[Axis | tuple[Axis, ...], ...]
    reversed: bool

    @property
    def datasets(self) -> list[str]:
        """The names of the data sets: one of complex numbers, or those of the real and the
        imaginary parts."""
        return [name for name in (self.dataset, self.real, self.imag) if name is not None]

    @property
    def counted(self) -> list[str]:
        """All that the axes count, in order; neighbouring axes `position` are one."""
        entries = groupby(self.axes, key=lambda axis: axis if axis == "position" else object())
        stored = [next(axes) for _, axes in entries]
        return [a for axis in stored for a in ((axis,) if isinstance(axis, str) else axis)]

    @model_validator(mode="after")
    def _require_named_once(self) -> "ComplexMapping":
        pair = self.real is not None and self.imag is not None
        if (self.dataset is not None) == pair or (self.real is None) != (self.imag is None):
            raise ValueError('give either dataset = "…" or both real = "…" and imag = "…"')
        if len(set(self.counted)) < len(self.counted):
            raise ValueError("an axis is named twice; name each axis once")
        axes = {*self.counted}
        if {"position"} < axes & {*PLACES} or {"pair"} < axes & {"tx", "rx", "pair"}:
            raise ValueError(
                'axes have both ways of naming antennas; take either "tx" and "rx" or "pair", and '
                'either "position" or "x" and "y"'
            )
        if RE_IM in self.counted and pair:
            raise ValueError(
                'real and imag are two data sets, so the axes must not include "re_im"; remove it'
            )
        return self


class GainsMapping(ComplexMapping):
    """What samples are divided by: gains of the channels, or the response of a probe.
    phase_only: divide by the phase only. passes: how often a wave went through what was measured:
    2 divides by the square."""

    phase_only: bool = False
    passes: Literal[1, 2] = 1


class SamplesMapping(ComplexMapping):
    """Where the echoes are, and how they are laid out.
    sign: the sign of j2πf·path/v in the exponent of an echo, and of its gain and background.
    sweeps: whether the sweeps of a frame are averaged ("mean") or become frames."""

    sign: Literal["-", "+"]
    sweeps: Literal["mean", "frames"] | None = None

    @model_validator(mode="after")
    def _all_axes(self) -> "SamplesMapping":
        if "frequency" not in self.counted:
            raise ValueError('the axes do not include "frequency"; add it')
        if not {*self.counted} & {*PLACES, "tx", "rx", "pair"}:
            raise ValueError(
                'the axes must include "tx" and "rx", or "pair", or the places of what is moved: '
                '"position", or "x" and "y"'
            )
        if (self.sweeps is not None) != ("sweep" in self.counted):
            raise ValueError(
                'the axis "sweep" and the key sweeps (= "mean" or "frames") need each other; give '
                "both or none"
            )
        return self


class FrequenciesMapping(Config):
    """The tones [f]: a data set, or steps."""

    dataset: InFile | None = None
    steps: Steps | None = None
    unit: Literal["Hz", "kHz", "MHz", "GHz"]

    @model_validator(mode="after")
    def _one_of_both(self) -> "FrequenciesMapping":
        if (self.dataset is None) == (self.steps is None):
            raise ValueError('give either dataset = "…" or steps = {start, step or stop, count}')
        return self


class TableMapping(Config):
    """Where a table [n, columns] is.
    dataset: the whole table. columns instead: one entry for each, a data set, a number, numbers, or
    steps. reversed: the file has the axes in opposite order, as MATLAB's files do."""

    dataset: InFile | None = None
    columns: tuple[Column, ...] | None = Field(default=None, min_length=1, max_length=3)
    reversed: bool | None = None

    @property
    def datasets(self) -> list[str]:
        """The names of its data sets."""
        return [name for name in (self.dataset, *(self.columns or ())) if isinstance(name, str)]

    @model_validator(mode="after")
    def _one_of_both(self) -> "TableMapping":
        if (self.dataset is None) == (self.columns is None):
            raise ValueError('give either dataset = "…" or columns = […]')
        if self.dataset is not None and self.reversed is None:
            raise ValueError(
                "reversed is missing; write reversed = true if the file stores the axes in the "
                "opposite order, as MATLAB does, else reversed = false"
            )
        return self


class PositionsMapping(TableMapping):
    """Positions of antennas (x, y, z), or of what is moved; a column that is left out is 0.
    x, y, z: where the axes point for somebody at the array who looks at the target (handbench's x
    points left)."""

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


class ArrayMapping(Config):
    """One array: its echoes, its antennas' positions, the measured pairs, the places to which it is
    moved, what is subtracted from its samples (background), and what they are divided by."""

    samples: SamplesMapping
    tx: PositionsMapping | None = None
    rx: PositionsMapping | None = None
    position: PositionsMapping | None = None
    pairs: PairsMapping | None = None
    background: ComplexMapping | None = None
    gains: GainsMapping | None = None

    @property
    def datasets(self) -> list[str]:
        """All data sets that the tables name."""
        tables = (
            self.samples,
            self.tx,
            self.rx,
            self.position,
            self.pairs,
            self.background,
            self.gains,
        )
        return [name for table in tables if table for name in table.datasets]

    @model_validator(mode="after")
    def _tables_of_the_axes(self) -> "ArrayMapping":
        axes = {*self.samples.counted}
        needed = {"position": axes & {*PLACES}, "pairs": axes & {"pair"}}
        if axes & {"tx", "rx", "pair"} or not needed["position"]:
            needed |= {"tx": {"tx"}, "rx": {"rx"}}
        for name, names in needed.items():
            if (getattr(self, name) is not None) != bool(names):
                raise ValueError(
                    f"the table [{name}] and, in samples.axes, "
                    + {"position": '"position", "x" or "y"', "pairs": '"pair"'}.get(
                        name, "antennas"
                    )
                    + " need each other; give both or none"
                )
        if self.position and self.position.dataset and "position" not in axes:
            raise ValueError('position.columns, not dataset, have the coordinates of axes "x", "y"')
        if (self.tx is None) != (self.rx is None):
            raise ValueError(
                "one of the tables [tx] and [rx] of what is moved is missing; give both or none"
            )
        for name in ("background", "gains"):
            found = getattr(self, name)
            if found and (other := {*found.counted} - axes - {RE_IM}):
                raise ValueError(
                    f'{name}.axes name "{min(other)}"; expected some of the axes of samples'
                )
        if self.gains and {*self.gains.counted} & {"frame", "sweep"}:
            raise ValueError(
                'gains.axes have "frame" or "sweep", but a gain belongs to a channel; remove them'
            )
        return self


class Mapping(ArrayMapping):
    """The content of `mapping.toml`. file: the one of names without a file; capture: the keys of a
    `capture.toml`; times_s, frame_times_s: when each tone of a frame and each frame was measured,
    seconds; array: further arrays, whose receivers record only their own transmitters."""

    version: Literal[1]
    file: InFile | None = None
    capture: CaptureFile
    frequencies: FrequenciesMapping
    times_s: Column | None = None
    frame_times_s: Column | None = None
    wave_speed_m_s: float = SPEED_OF_LIGHT_M_S
    licence: str = ""
    array: tuple[ArrayMapping, ...] = ()
