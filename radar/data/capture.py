"""Radar captures: the echoes of one scene, and their conversion from samples of any layout."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from handbench.radar.data.arrays import (
    SPEED_OF_LIGHT_M_S,
    AntennaArray,
    AntennaPairs,
    Aperture,
    numbers,
    positions,
    range_period_m,
    times,
    tones,
)
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError

SLOWEST = 100  # how many times slower than in vacuum a wave may be (in water: 9)
QUIETEST, LOUDEST = 1e-30, 3e38  # range of the largest real or imaginary part that complex64 holds
FARTHEST_M = 10.0  # of a range profile
RANGES = 4000  # in it
USUAL_M = 1.5  # to which it is shown, unless its largest level is farther
MOST_CHANNELS = 256  # of which it is the mean
# An array with more than this many times the measured pairs becomes a list of pairs.
SPARSE = 8
UNITS = ((1e9, "GHz"), (1e6, "MHz"), (1e3, "kHz"), (1.0, "Hz"))


@dataclass(frozen=True)
class RadarCapture:
    """The echoes of one scene, as frequency-domain samples. Raises HandbenchError for fields that
    are invalid or do not fit together.

    samples: complex64 [frame, f, t, r], or [frame, f, n] of a scan; frequencies_hz: [f], in any
    order, perhaps some repeatedly; wave_speed_m_s: speed of waves in the medium in front of the
    antennas; source, licence: origin and licence of the recording; calibration: content of the
    antennas' `array.json`, not applied yet (`calibration.array_file`); times_s:
    [f], when each tone is measured, seconds from the start of its frame; frame_times_s: [frame],
    when each frame starts, ascending (both None if unknown).
    """

    samples: np.ndarray
    frequencies_hz: np.ndarray
    aperture: Aperture
    wave_speed_m_s: float = SPEED_OF_LIGHT_M_S
    source: str = ""
    licence: str = ""
    calibration: Any = None
    times_s: np.ndarray | None = None
    frame_times_s: np.ndarray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequencies_hz", tones("frequencies_hz", self.frequencies_hz))
        if not SPEED_OF_LIGHT_M_S / SLOWEST <= self.wave_speed_m_s <= SPEED_OF_LIGHT_M_S:
            raise HandbenchError(
                f"wave_speed_m_s: is {self.wave_speed_m_s:g} m/s; expected 1/{SLOWEST} to 1 times "
                f"the speed of light in vacuum, {SPEED_OF_LIGHT_M_S:g} m/s"
            )
        if "\0" in self.source + self.licence:
            raise HandbenchError(
                "source, licence: one of these texts has a NUL character; remove it"
            )
        expected = (len(self.frequencies_hz), *self.aperture.channels)
        if (
            self.samples.ndim != 1 + len(expected)
            or self.samples.shape[1:] != expected
            or len(self.samples) == 0
        ):
            raise HandbenchError(
                f"samples: have shape {self.samples.shape}; expected [frame, "
                f"{', '.join(map(str, expected))}] from the numbers of frequencies and antennas"
            )
        counts = {"times_s": len(self.frequencies_hz), "frame_times_s": len(self.samples)}
        for name, count in counts.items():
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, times(name, given, count))
        if self.frame_times_s is not None and (np.diff(self.frame_times_s) <= 0).any():
            raise HandbenchError(
                "frame_times_s: are not ascending; put the frames in the order in which they were "
                "measured"
            )
        bad = int(np.count_nonzero(~np.isfinite(self.samples)))
        if bad:
            first = tuple(int(i) for i in np.argwhere(~np.isfinite(self.samples))[0])
            raise HandbenchError(
                f"samples: {bad} of {self.samples.size} are NaN or infinite, the first at index "
                f"{first}; repair these samples, or leave the capture out"
            )

    def first_frames(self, count: int | None) -> "RadarCapture":
        """Return the capture with only its first `count` frames (None: all)."""
        times_s = None if self.frame_times_s is None else self.frame_times_s[:count]
        return replace(self, samples=self.samples[:count], frame_times_s=times_s)

    def tones(self, wanted_hz: ArrayLike, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Return the samples [f, …] of the measured tones nearest to wanted_hz [f], and the
        frequencies [f] of these tones that have the same wavelengths in vacuum, hertz. In a medium
        with wave speed v they are f·c/v; with them the formulas for vacuum are valid. Raises
        HandbenchError as `tone_index` does."""
        index = self.tone_index(wanted_hz)
        return self.samples[frame][index], self.vacuum_hz[index]

    @property
    def vacuum_hz(self) -> np.ndarray:
        """The frequencies [f], hertz, that have the tones' wavelengths in vacuum: f·c/v."""
        return self.frequencies_hz * (SPEED_OF_LIGHT_M_S / self.wave_speed_m_s)

    def tone_index(self, wanted_hz: ArrayLike) -> np.ndarray:
        """Return the indices [f] of the measured tones nearest to wanted_hz [f]; of a repeated tone
        it is that of its earliest measurement.

        Raises HandbenchError for a tone that is further from every measured one than half their
        median spacing and 1 MHz, and for two tones for which the same measured one is nearest.
        """
        wanted = np.asarray(wanted_hz, np.float64)
        order = slice(None) if self.times_s is None else np.argsort(self.times_s, kind="stable")
        earliest = np.arange(len(self.frequencies_hz))[order]
        index = earliest[np.abs(self.frequencies_hz[earliest] - wanted[:, None]).argmin(axis=1)]
        off = np.abs(self.frequencies_hz[index] - wanted)
        different = np.unique(self.frequencies_hz)
        spacing = np.median(np.diff(different)) if len(different) > 1 else 0.0
        worst = int(off.argmax())
        if off[worst] > max(0.5 * spacing * (1 + 1e-6), 1e6):
            nearest_hz = self.frequencies_hz[index[worst]]
            unit_hz, unit = fitting_unit(nearest_hz)
            raise HandbenchError(
                f"frequencies: the method needs a tone at {wanted[worst] / 1e9:.4f} GHz, but the "
                f"nearest one of the capture, {nearest_hz / unit_hz:.4f} {unit}, is "
                f"{off[worst] / 1e6:.1f} MHz away; set the method's tones to measured ones"
            )
        if len(np.unique(index)) < len(index):
            raise HandbenchError(
                f"frequencies: two of the method's {len(wanted)} tones have the same nearest tone "
                f"among the capture's {len(self.frequencies_hz)}; choose tones that are further "
                "apart"
            )
        return index


def to_capture(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    places_m: dict[str, np.ndarray],
    pairs: np.ndarray | None = None,
    gains: np.ndarray | None = None,
    sweeps: str | None = None,
    **fields: Any,
) -> RadarCapture:
    """Convert the numbers in a capture file of any layout to a `RadarCapture`. Channels that were
    not measured are left out (of a scan or list of pairs) or set to 0 (of an array).

    samples: [frame, frequency, …], last axes (tx, rx), (pair,) or (position,); a channel that was
    not measured is NaN throughout. places_m: antenna positions by name, either tx_m and rx_m or
    position_m, [n, 3] each, metres. pairs [n, 2]: indices of the transmitter and the receiver of
    each pair, from 0. gains: complex [channels] or [frequency, channels]; samples are divided by
    them, and 0 or NaN marks a dead channel. sweeps: of samples [frame, sweep, frequency, …], "mean"
    to average the sweeps, "frames" to make each a frame. fields: further ones of the capture.
    Raises HandbenchError for numbers that do not fit together, and if no channel was measured.
    """
    tones("frequencies_hz", frequencies_hz)
    samples = numbers("samples", samples)
    ends_m = [positions(name, place_m) for name, place_m in places_m.items()]
    channels = tuple(map(len, ends_m))
    if pairs is not None:
        _check_pairs(pairs, *channels)
        channels = (len(pairs),)
    expected = len(frequencies_hz), *channels
    first = ["frame", "sweep"] if sweeps else ["frame"]
    if samples.size == 0 or samples.shape[len(first) :] != expected:
        axes = ", ".join(map(str, (*first, *expected)))
        raise HandbenchError(
            f"samples: have shape {samples.shape}; expected [{axes}] from the numbers of "
            "frequencies and antennas"
        )
    if gains is not None and gains.shape not in (expected, channels):
        raise HandbenchError(
            f"gains: have shape {gains.shape}; expected {channels}, or {expected} with gains for "
            "each tone"
        )
    missing = np.isnan(samples).all(axis=tuple(range(len(first) + 1)))
    with np.errstate(invalid="ignore", over="ignore"):  # RadarCapture refuses infinite samples
        if sweeps == "mean":
            samples = samples.mean(axis=1, dtype=np.complex128)
        samples = samples.reshape(-1, *expected)
        if gains is not None:
            alive = np.isfinite(gains) & (gains != 0)
            samples = samples / np.where(alive, gains, 1)
            missing |= ~(alive if gains.shape == channels else alive.all(axis=0))
        samples = as_complex64(np.where(missing, 0, samples) if missing.any() else samples)
    if missing.all():
        raise HandbenchError(
            "samples: all are NaN, so no channel was measured; give numbers for the measured "
            "channels and NaN for the others"
        )
    aperture: Aperture
    if len(ends_m) == 1:
        places = ends_m[0][~missing]
        samples, aperture = samples[..., ~missing], AntennaPairs(places, places)
    elif pairs is None:
        aperture = AntennaArray(ends_m[0], ends_m[1], ~missing)
    else:
        t, r = pairs[~missing].T.astype(np.intp)
        samples, aperture = _of_pairs(samples[..., ~missing], t, r, *ends_m)
    return RadarCapture(samples, frequencies_hz, aperture, **fields)


def _of_pairs(
    samples: np.ndarray, t: np.ndarray, r: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray
) -> tuple[np.ndarray, Aperture]:
    """Convert samples [frame, f, n] of antenna pairs to those of an array: (samples [frame, f, t,
    r], which are 0 for pairs that were not measured, and the `AntennaArray`).

    t, r [n]: indices of each pair's transmitter and receiver. If few of all possible pairs were
    measured, the result is (unchanged samples, `AntennaPairs`).
    """
    if len(tx_m) * len(rx_m) > SPARSE * len(t):
        return samples, AntennaPairs(tx_m[t], rx_m[r])
    shape = (*samples.shape[:2], len(tx_m), len(rx_m))
    require_memory(
        8 * float(np.prod(shape)),
        f"samples: {shape}",
        "close other programs, or cut the file into parts",
    )
    filled, measured = np.zeros(shape, np.complex64), np.zeros(shape[2:], bool)
    filled[:, :, t, r], measured[t, r] = samples, True
    return filled, AntennaArray(tx_m, rx_m, measured)


def _check_pairs(pairs: np.ndarray, n_tx: int, n_rx: int) -> None:
    good = pairs.ndim == 2 and pairs.shape[1] == 2 and pairs.dtype.kind in "iuf"
    if not good or not ((pairs >= 0) & (pairs < [n_tx, n_rx]) & (pairs == np.rint(pairs))).all():
        raise HandbenchError(
            f"pairs: are {pairs.dtype} of shape {pairs.shape}; expected [n, 2] whole numbers: a "
            f"transmitter from 0 to {n_tx - 1} and a receiver from 0 to {n_rx - 1}"
        )
    if (often := len(pairs) - len(np.unique(pairs, axis=0))) > 0:
        raise HandbenchError(
            f"pairs: {often} rows repeat an earlier pair; give each pair once, and repeated "
            "sweeps along the frame axis"
        )


def fitting_unit(frequency_hz: float) -> tuple[float, str]:
    """Return the largest of GHz, MHz, kHz and Hz in which a frequency is at least 1: its size in
    hertz and its name."""
    return next((unit for unit in UNITS if frequency_hz >= unit[0]), UNITS[-1])


def as_complex64(samples: np.ndarray) -> np.ndarray:
    """Convert samples to complex64. Raises HandbenchError if complex64 cannot hold their largest
    real or imaginary part: above LOUDEST, or below QUIETEST but not 0."""
    if samples.dtype == np.complex64:
        return np.ascontiguousarray(samples)
    largest = largest_part(samples)
    if LOUDEST < largest < np.inf or 0 < largest < QUIETEST:
        raise HandbenchError(
            f"samples: the largest has the magnitude {largest:.3g}; expected {QUIETEST:g} to "
            f"{LOUDEST:g}; multiply all samples by a constant"
        )
    return np.ascontiguousarray(samples, np.complex64)


def largest_part(samples: np.ndarray) -> float:
    """Return the largest magnitude of all real and imaginary parts; NaN if one of them is NaN."""
    parts = _parts(samples)
    return float(np.maximum(float(parts.max(initial=0)), -float(parts.min(initial=0))))


def scaled_to_one(samples: np.ndarray) -> np.ndarray:
    """Return the samples times a power of two that brings their largest magnitude near 1. No digit
    is lost, and powers and sums of the samples stay within float32, whatever the receiver's
    unit."""
    largest = largest_part(samples := np.asarray(samples, np.result_type(samples, np.complex64)))
    if not 0 < largest < np.inf:
        return samples
    exponent, parts = int(np.frexp(largest)[1]), _parts(samples)
    # a product, for powers of two that float32 holds, is ten times as fast as `ldexp`
    usual = abs(exponent) < 100
    return (parts * parts.dtype.type(2.0**-exponent) if usual else np.ldexp(parts, -exponent)).view(
        samples.dtype
    )


def _parts(samples: np.ndarray) -> np.ndarray:
    """View complex samples as real numbers, with real and imaginary parts in turn along the last
    axis."""
    return np.ascontiguousarray(samples).view(samples.real.dtype)


def even_subset(count: int, most: int) -> np.ndarray:
    """Choose at most `most` of the indices 0 to count − 1, evenly spaced, including the first and
    the last."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def range_profile(capture: RadarCapture) -> tuple[np.ndarray, np.ndarray]:
    """Compute the mean level of the first frame's echoes over range: ranges [n], metres, up to the
    unambiguous one or well beyond the largest level, and levels [n], dB below the largest (-inf or
    NaN without any echo)."""
    f_hz, samples = capture.vacuum_hz, capture.samples[0].reshape(len(capture.vacuum_hz), -1)
    range_m = np.linspace(0, min(range_period_m(f_hz), FARTHEST_M), RANGES)
    phase = 4j * np.pi / SPEED_OF_LIGHT_M_S * np.outer(range_m, f_hz)
    some = samples[:, :: 1 + samples.shape[1] // MOST_CHANNELS]
    power = np.mean(np.abs(np.exp(phase) * np.hanning(len(f_hz) + 2)[1:-1] @ some) ** 2, axis=1)
    shown = range_m <= max(USUAL_M, 1.5 * range_m[power.argmax()])
    return range_m[shown], 10 * np.log10(power / power.max())[shown]


def thin_antennas(capture: RadarCapture, every: int) -> RadarCapture:
    """Return the capture with only every n-th transmitter and every n-th receiver of an array, n =
    `every`, counted from the first, or with every n-th position of a scan. Raises HandbenchError
    for n less than 1."""
    if every < 1:
        raise HandbenchError(
            f"every_nth_antenna: is {every}; expected a whole number ≥ 1 (1: all antennas)"
        )
    if every == 1:
        return capture
    aperture, some = capture.aperture, slice(None, None, every)
    fewer = {name: value[some] for name, value in vars(aperture).items() if value is not None}
    fewer |= {name: value[:, some] for name, value in fewer.items() if name == "measured"}
    samples = capture.samples[:, :, *[some] * len(aperture.channels)]
    return replace(
        capture, samples=np.ascontiguousarray(samples), aperture=replace(aperture, **fewer)
    )
