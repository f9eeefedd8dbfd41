"""Descriptions of echoes in somebody else's HDF5 or MATLAB file: `mapping.toml`."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from handbench.bench.datasets.native import CaptureFile
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.support.config import Config

MAPPING = "mapping.toml"
RE_IM = "re_im"  # an axis of two: real and imaginary part
CHANNELS = ({"tx", "rx"}, {"pair"}, {"position"})  # that samples have axes of, and …
TABLES = ({"tx", "rx"}, {"tx", "rx", "pairs"}, {"position"})  # … the tables that there are then
InFile = Annotated[str, Field(min_length=1, max_length=1000)]
Axis = Literal["frame", "sweep", "frequency", "tx", "rx", "pair", "position", "re_im"]


class Gains(Config):
    """Place and form of complex numbers in the file, here of the gains that samples are divided by. axes: as the
    program that wrote them counts them; reversed: the file's order is the opposite, as MATLAB's is, whose arrays are
    stored by column."""

    dataset: InFile | None = None
    real: InFile | None = None
    imag: InFile | None = None
    axes: tuple[Axis, ...]
    reversed: bool

    @property
    def datasets(self) -> list[str]:
        """The one of complex numbers, or that of the real and that of the imaginary parts."""
        return [name for name in (self.dataset, self.real, self.imag) if name is not None]

    @property
    def channels(self) -> set[str]:
        """Those of its axes that count antennas."""
        return {str(axis) for axis in self.axes} - {"frame", "sweep", "frequency", RE_IM}

    @model_validator(mode="after")
    def _told_once(self) -> "Gains":
        pair = self.real is not None and self.imag is not None
        if (self.dataset is not None) == pair or (self.real is None) != (self.imag is None):
            raise ValueError('give either dataset = "…" or both real = "…" and imag = "…"')
        if len(set(self.axes)) < len(self.axes):
            raise ValueError("axes name each axis once")
        if self.channels not in CHANNELS:
            raise ValueError('axes hold "tx" and "rx", or "pair", or "position" of a transceiver that is moved')
        if RE_IM in self.axes and pair:
            raise ValueError('real and imag are two data sets; axes then have no "re_im"')
        return self


class Samples(Gains):
    """Place and form of the echoes. sign: of j2πf·path/v in the exponent of an echo, and of its gain; sweeps: what
    those of a frame become."""

    sign: Literal["-", "+"]
    sweeps: Literal["mean", "frames"] | None = None

    @model_validator(mode="after")
    def _all_axes(self) -> "Samples":
        if "frequency" not in self.axes:
            raise ValueError('axes name "frequency"')
        if (self.sweeps is not None) != ("sweep" in self.axes):
            raise ValueError('sweeps = "mean" or "frames" is there if, and only if, axes name "sweep"')
        return self


class Frequencies(Config):
    """Place of the tones [f] in the file."""

    dataset: InFile
    unit: Literal["Hz", "kHz", "MHz", "GHz"]


class Positions(Config):
    """Place of the antennas' positions [n, 3] (x, y, z) in the file. reversed: as in `Gains`; x: its direction, seen
    from the array looking at the target (ours points to the left)."""

    dataset: InFile
    unit: Literal["m", "cm", "mm"]
    reversed: bool
    x: Literal["left", "right"]


class Pairs(Config):
    """Place of the pairs [n, 2] (transmitter, receiver) in the file. reversed: as in `Gains`; first: what the first
    antenna is counted as, 1 in MATLAB."""

    dataset: InFile
    reversed: bool
    first: Literal[0, 1]


class Array(Config):
    """One array: its echoes, where its antennas are, which pairs of them were measured, and their gains."""

    samples: Samples
    tx: Positions | None = None
    rx: Positions | None = None
    position: Positions | None = None
    pairs: Pairs | None = None
    gains: Gains | None = None

    @property
    def datasets(self) -> list[str]:
        """All data sets that it names, but that of the tones."""
        tables = [self.tx, self.rx, self.position, self.pairs]
        complexes = [self.samples, self.gains]
        return [t.dataset for t in tables if t] + [name for c in complexes if c for name in c.datasets]

    @model_validator(mode="after")
    def _tables_of_the_axes(self) -> "Array":
        needed = TABLES[CHANNELS.index(self.samples.channels)]
        for name in ("tx", "rx", "position", "pairs"):
            if (getattr(self, name) is not None) != (name in needed):
                raise ValueError(
                    f'the table [{name}] is there if, and only if, samples.axes name "{name.removesuffix("s")}"'
                    + (' or "pair"' if name in ("tx", "rx") else "")
                )
        if self.gains and {*self.gains.axes} - {"frequency", RE_IM} != self.samples.channels:
            raise ValueError('gains.axes name the antennas as samples.axes do, and "frequency" if they differ by tone')
        return self


class Mapping(Array):
    """The content of `mapping.toml`; capture: as in a `capture.toml`; array: further ones, which hear themselves."""

    version: Literal[1]
    file: InFile
    capture: CaptureFile
    frequencies: Frequencies
    wave_speed_m_s: float = SPEED_OF_LIGHT_M_S
    licence: str = ""
    array: tuple[Array, ...] = ()
