"""The content of a `mapping.toml`: which arrays of another program's files are a capture, and how
they are laid out."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from handbench.bench.datasets.native import CaptureFile
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.support.config import Config

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
