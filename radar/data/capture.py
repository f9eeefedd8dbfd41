"""Radar captures: the echoes of one scene, and their file `echoes.h5`."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from radar.data.arrays import AntennaArray, Aperture, PlanarScan, tones
from radar.data.grid import PixelGrid
from radar.support.errors import HandbenchError
from radar.support.files import atomic_path, require_file
from radar.support.hdf5 import attribute, opened, read

if TYPE_CHECKING:
    import h5py

FORMAT, VERSION = "handbench-echoes", 1
HEADERS_BYTES = 2**12  # of the file, at least
QUIETEST, LOUDEST = 1e-30, 3e38  # largest part of samples that complex64 keeps with their digits


@dataclass(frozen=True)
class RadarCapture:
    """samples: complex64 [frame, f, t, r] (or [frame, f, n] of a PlanarScan); frequencies_hz: [f], ascending or not.
    sensors: by name the other sensors that saw the scene, each z_m [ny, nx] of a grid's pixels in a frame."""

    samples: np.ndarray
    frequencies_hz: np.ndarray
    aperture: Aperture
    sensors: Mapping[str, Callable[[PixelGrid, int], np.ndarray]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequencies_hz", tones("frequencies_hz", self.frequencies_hz))
        expected = (len(self.frequencies_hz), *self.aperture.channels)
        if self.samples.ndim != 1 + len(expected) or self.samples.shape[1:] != expected or len(self.samples) == 0:
            raise HandbenchError(
                f"samples: have shape {self.samples.shape}; expected [frame, {', '.join(map(str, expected))}] "
                "from the numbers of frequencies and antennas"
            )
        bad = int(np.count_nonzero(~np.isfinite(self.samples)))
        if bad:
            first = tuple(int(i) for i in np.argwhere(~np.isfinite(self.samples))[0])
            raise HandbenchError(
                f"samples: {bad} of {self.samples.size} are NaN or infinite, the first at {first}; "
                "repair or leave out the capture"
            )

    def tones(self, wanted_hz: ArrayLike, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Samples and true frequencies of the measured tones nearest to wanted_hz: ([f, …], [f]).

        A tone further away than half the median spacing of the measured ones (at least 1 MHz) is an error: the method
        asks for what was not measured. Formulas use the true frequencies.
        """
        wanted = np.asarray(wanted_hz, np.float64)
        index = np.abs(self.frequencies_hz[None] - wanted[:, None]).argmin(axis=1)
        off = np.abs(self.frequencies_hz[index] - wanted)
        spacing = np.median(np.diff(np.sort(self.frequencies_hz))) if len(self.frequencies_hz) > 1 else 0.0
        worst = int(off.argmax())
        if off[worst] > max(0.5 * spacing * (1 + 1e-6), 1e6):
            low, high = self.frequencies_hz.min() / 1e9, self.frequencies_hz.max() / 1e9
            raise HandbenchError(
                f"frequencies: the method asks for {wanted[worst] / 1e9:.4f} GHz, but the capture has "
                f"{len(self.frequencies_hz)} tones in {low:.4f}–{high:.4f} GHz, the nearest "
                f"{off[worst] / 1e6:.1f} MHz away; set the method's tones to measured ones"
            )
        if len(np.unique(index)) < len(index):
            raise HandbenchError(
                f"frequencies: two of the {len(wanted)} tones asked for fall on the same measured tone; "
                "choose tones further apart"
            )
        return self.samples[frame][index], self.frequencies_hz[index]


def single(samples: np.ndarray) -> np.ndarray:
    """Samples as complex64; HandbenchError where that would make all of them zero, or one infinite."""
    largest = largest_part(samples)
    if samples.dtype != np.complex64 and (LOUDEST < largest < np.inf or 0 < largest < QUIETEST):
        raise HandbenchError(f"samples: reach {largest:.3g}; expected {QUIETEST:g} to {LOUDEST:g}: take another unit")
    return np.ascontiguousarray(samples, np.complex64)


def largest_part(samples: np.ndarray) -> float:
    """Largest magnitude of a real or imaginary part; NaN where one is."""
    parts = (samples.real, samples.imag)
    return float(np.max([(float(part.max(initial=0)), -float(part.min(initial=0))) for part in parts]))


def near_one(samples: np.ndarray) -> np.ndarray:
    """The samples times the power of two that brings the largest near 1: not a digit is lost, and powers and sums of
    them stay within float32, whatever the receiver's unit."""
    largest = largest_part(samples)
    if not 0 < largest < np.inf:
        return samples
    exponent = int(np.frexp(largest)[1])
    apart = np.ascontiguousarray(samples).view(samples.real.dtype)
    return np.ldexp(apart, -exponent).view(samples.dtype)


def thinned(capture: RadarCapture, every: int) -> RadarCapture:
    """The capture of an array with fewer antennas: every `every`-th transmitter and receiver in the order of the file,
    from the first; of a planar scan every `every`-th position. HandbenchError for less than 1."""
    if every < 1:
        raise HandbenchError(f"every_nth_antenna: is {every}; expected a whole number ≥ 1 (1: all antennas)")
    if every == 1:
        return capture
    fewer = {name: places_m[::every] for name, places_m in vars(capture.aperture).items()}
    samples = capture.samples[:, :, *[slice(None, None, every)] * len(capture.aperture.channels)]
    return replace(capture, samples=np.ascontiguousarray(samples), aperture=replace(capture.aperture, **fewer))


def save_capture(path: str | Path, capture: RadarCapture) -> None:
    """Write `echoes.h5`, atomically."""
    import h5py

    places = vars(capture.aperture)  # tx_m and rx_m, or position_m
    size = 8 * capture.samples.size + capture.frequencies_hz.nbytes + sum(p.nbytes for p in places.values())
    with atomic_path(path) as temporary:
        with temporary.open("wb") as stream:  # is there room? HDF5 finds out late, and then prints tracebacks
            os.posix_fallocate(stream.fileno(), 0, size + HEADERS_BYTES)
        try:
            with h5py.File(temporary, "w") as file:
                file.attrs["format"], file.attrs["version"] = FORMAT, VERSION
                file["samples"] = single(capture.samples)
                file["frequencies_hz"] = capture.frequencies_hz
                for name, places_m in places.items():
                    file[name] = places_m
        except RuntimeError as error:  # what the library calls a disk that is full by the time the file is closed
            raise OSError("the library could not close the file; is there space left on the disk?") from error


def load_capture(path: str | Path) -> RadarCapture:
    """Read `echoes.h5`; a broken, foreign or inconsistent file is a HandbenchError."""
    path = require_file(path, "an echoes.h5 file")
    try:
        with opened(path) as file:
            found = attribute(file, "format"), attribute(file, "version")
            if not np.array_equal(found, (FORMAT, VERSION)):
                raise HandbenchError(f"{path}: has format {found}; expected ('{FORMAT}', {VERSION})")
            samples = _numbers(file, "samples", path, "iufc")
            frequencies_hz = _numbers(file, "frequencies_hz", path).astype(np.float64)
            if file.get("position_m", getlink=True) is not None:
                aperture: Aperture = PlanarScan(_numbers(file, "position_m", path))
            else:
                aperture = AntennaArray(_numbers(file, "tx_m", path), _numbers(file, "rx_m", path))
    except HandbenchError:
        raise
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise HandbenchError(f"{path}: is not a readable echoes.h5 ({error}); record or copy it again") from error
    try:
        return RadarCapture(single(samples), frequencies_hz, aperture)
    except HandbenchError as error:
        raise HandbenchError(f"{path}: {error}") from None


def _numbers(file: "h5py.File", name: str, path: Path, kinds: str = "iuf") -> np.ndarray:
    """A data set of numbers that lie in this very file; kinds: numpy's, of real numbers by default."""
    values = read(file, name, path)
    if values.dtype.kind not in kinds:
        raise ValueError(f"'{name}' holds {values.dtype}, no {'' if 'c' in kinds else 'real '}numbers")
    return values
