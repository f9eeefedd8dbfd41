"""Checks of whether echoes can show a depth at all: which tones and channels contain echoes, and
how well the antennas resolve."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from handbench.radar.data.arrays import channel_ends, lateral_cell_m
from handbench.radar.data.capture import RadarCapture, scaled_to_one
from handbench.radar.methods.doppler import repetition
from handbench.radar.methods.settings import MethodSettings
from handbench.support.errors import HandbenchError

PLACED = 5  # decimals of a metre to which antennas are known to be placed
POINT_WAVELENGTHS = 0.01  # antennas that span less are in one place
UNSIGNED = 0.01  # of the largest part of a sample: signed ones come as near to 0 only by chance
FEW = 64  # samples that may have one sign, or channels that may be equal, by chance
SILENT = 0.01  # share of a frame's samples that may be 0 by chance
COMMON = 0.9  # share of the power that no target within NEAR_M causes alike in all channels
NEAR_M = 1.0
LOUD = 6.0  # times the median tone, 15 dB: more than a band's edge or two echoes in phase
EQUAL = 1e-5  # difference of two tones' samples below which they are copies, with rounding
COPIED = 1e-12  # lack of coherence of copies: rounding causes 1e-14, noise of -100 dB 1e-10
COMPARED = 1000
NAMED = 5  # runs of numbers at most that a sentence names


def require_evidence(capture: RadarCapture, config: MethodSettings, frame: int = 0) -> None:
    """Raise HandbenchError for a frame whose echoes cannot show depths by a method.

    That is so if it has no echo, if a tone that the method needs is missing or has no echo, if two
    tones have equal samples, if all antennas with echoes have the same coordinate along an axis
    with several pixels, or if they are all on one line though there are several pixels along x and
    y.
    """
    index = needed_tones(capture, config)
    samples = capture.samples[frame]
    if not samples.any():
        raise HandbenchError(
            f"echoes: frame {frame} has no echo; choose another frame, or record it again"
        )
    for sentence in tone_problems(samples[index], capture.frequencies_hz[index]):
        raise HandbenchError(f"echoes: in frame {frame}, {sentence}")
    point_m = POINT_WAVELENGTHS * shortest_m(capture)
    *extents_m, width_m = live_extents_m(capture, frame)
    counts = {"x": config.x.count, "y": config.y.count}
    for (name, pixels), extent_m in zip(counts.items(), extents_m, strict=True):
        if pixels > 1 and extent_m < point_m:
            raise HandbenchError(
                f"echoes: in frame {frame}, all antennas with echoes have the same {name}, so the "
                f"{pixels} pixels along {name} cannot be distinguished; use antennas at several "
                f"{name}, or set {name}.stop_m = {name}.start_m for one pixel"
            )
    if min(counts.values()) > 1 and width_m < point_m:
        raise HandbenchError(
            f"echoes: in frame {frame}, all antennas with echoes are on one oblique line, so the "
            "pixels across this line cannot be distinguished; use antennas beside the line, or "
            "set y.stop_m = y.start_m for one row of pixels"
        )


def needed_tones(capture: RadarCapture, config: MethodSettings) -> np.ndarray:
    """Return the indices of a capture's tones that a method needs. Raises HandbenchError if one was
    not measured, or none twice for a method that needs that."""
    index = capture.tone_index(config.frequencies_hz)
    if getattr(config, "doppler", False):
        index = np.append(index, repetition(capture, index).measured[1:])
    return index


def frames_with_echoes(samples: np.ndarray) -> list[int]:
    """Return the numbers of the frames [frame, …] that have an echo."""
    return [number for number, frame in enumerate(samples) if frame.any()]


def different_frames(samples: np.ndarray) -> list[int]:
    """Return the numbers of the frames [frame, …] that have an echo and do not repeat an earlier
    frame, up to a complex gain and rounding: each has noise of its own, and counts for the
    precision. Of large frames COMPARED samples are compared."""
    alive, flat = frames_with_echoes(samples), samples.reshape(len(samples), -1)
    live = np.flatnonzero(flat.any(axis=0))
    frames = flat[:, live[:: 1 + len(live) // COMPARED]][alive].astype(np.complex128)
    norms = np.linalg.norm(frames, axis=1, keepdims=True)
    frames /= np.maximum(norms, np.finfo(np.float64).tiny)
    repeats = np.abs(frames @ frames.conj().T) > 1 - COPIED
    return [number for k, number in enumerate(alive) if not repeats[k, :k].any()]


def frame_problems(samples: np.ndarray) -> Iterator[str]:
    """Yield a sentence for the user about the frames [frame, …] without any echo, and about those
    that repeat an earlier one."""
    alive, different = frames_with_echoes(samples), different_frames(samples)
    if silent := [*({*range(len(samples))} - {*alive})]:
        yield (
            f"{_numbered(silent, len(samples), 'frames')} have no echo; the recording may have "
            "been cut short"
        )
    if repeated := [*({*alive} - {*different})]:
        yield (
            f"{_numbered(repeated, len(samples), 'frames')} repeat an earlier one up to a "
            "gain, so they have no noise and count for no precision; check that they were "
            "recorded, and that no file is read twice"
        )


def tone_problems(samples: np.ndarray, frequencies_hz: np.ndarray) -> Iterator[str]:
    """Yield a sentence for the user about each tone without echoes, and about each two different
    frequencies whose samples are equal up to a gain and rounding. samples [f, …]: those of one
    frame; frequencies_hz [f]."""
    at = [f"{frequency_hz / 1e9:.10g}" for frequency_hz in frequencies_hz.tolist()]
    means = []  # equal tones have equal ones; so they are neighbours when sorted
    for i, tone in enumerate(samples):
        if tone.any():
            means.append((complex(_unit(tone).mean(dtype=np.complex128)), i))
        else:
            yield (
                f"the tone at {at[i]} GHz is 0 in every channel; leave this tone out, or record "
                "it again"
            )
    means.sort(key=lambda mean: mean[0].real)
    for (one, i), (other, j) in pairwise(means):
        near = at[i] != at[j] and abs(one - other) < EQUAL
        if near and np.abs(_unit(samples[i]) - _unit(samples[j])).max() < EQUAL:
            first, second = sorted((i, j))
            yield (
                f"the tones at {at[first]} and {at[second]} GHz have equal samples, so their "
                "phases give no distance; correct the frequencies or samples, or record each tone"
            )


def lost_problems(capture: RadarCapture) -> Iterator[str]:
    """Yield a sentence for the user if a part of the samples, or their sign, was lost on the way to
    the file, or if channels end early in a frame."""
    samples = capture.samples.reshape(*capture.samples.shape[:2], -1)
    for name, part in (("real", samples.real), ("imaginary", samples.imag)):
        if samples.any() and not part.any():
            yield f"its samples have no {name} part; both parts are needed, I and Q: export both"
        elif samples.size > FEW and 0 <= part.min() < UNSIGNED * part.max():
            yield (
                f"the {name} part of no sample is negative; if the sign was lost, read the numbers "
                "as signed ones, and take no magnitudes"
            )
    for frame, each in enumerate(samples):
        silent = each[each.any(axis=1)][:, each.any(axis=0)] == 0
        if silent.size and silent.mean() > SILENT:
            yield (
                f"frame {frame}: {100 * silent.mean():.0f} % of the samples of channels with "
                "echoes are 0; the recording may have been cut short"
            )
            return


def leakage_problems(capture: RadarCapture) -> Iterator[str]:
    """Yield a sentence for the user if most of the power of the first frame is the same in all
    channels, whose antennas are so far apart that no target within a metre causes that."""
    samples = scaled_to_one(capture.samples[0]).reshape(len(capture.frequencies_hz), -1)
    live = samples.any(axis=0)
    if np.count_nonzero(live) <= FEW:
        return
    ends_m = np.array(channel_ends(capture.aperture))[:, live]
    to_m = np.linalg.norm(ends_m - ends_m.mean(axis=(0, 1)) - [0, 0, NEAR_M], axis=2)
    common = (np.abs(samples[:, live].mean(axis=1)) ** 2).sum()
    common /= (np.abs(samples[:, live]) ** 2).mean(axis=1).sum()
    if common > COMMON and np.ptp(to_m.sum(axis=0)) > shortest_m(capture) / 2:
        yield (
            f"{100 * common:.1f} % of the power is the same in all channels, as what leaks from "
            "transmitter to receiver is; subtract the mean over the channels ([background] mean = "
            '"positions" in a mapping.toml)'
        )


def level_problems(capture: RadarCapture) -> Iterator[str]:
    """Yield a sentence for the user about each tone that is much stronger than the others in the
    first frame."""
    tones = capture.samples[0].reshape(len(capture.frequencies_hz), -1)
    levels = np.linalg.norm(scaled_to_one(tones), axis=1)
    usual = np.median(levels[levels > 0]) if levels.any() else np.inf
    for level, hz in zip(levels, capture.frequencies_hz, strict=True):
        if level > LOUD * usual:
            yield (
                f"the tone at {hz / 1e9:.10g} GHz is {20 * np.log10(level / usual):.0f} dB "
                "stronger than the median tone; leave it out, or record it again"
            )


def channel_problems(capture: RadarCapture) -> Iterator[str]:
    """Yield sentences for the user about frames without noise of their own, about tones that stand
    out, and about dead and copied tones and dead antennas, in the first frame that has any."""
    yield from frame_problems(capture.samples)
    yield from level_problems(capture)
    for frame, samples in enumerate(capture.samples):
        if not samples.any():
            continue
        tones = tone_problems(samples, capture.frequencies_hz)
        if dead := [*tones, *antenna_problems(samples)]:
            yield from (f"frame {frame}: {problem}" for problem in dead)
            return  # further frames are likely to have the same


def pair_problems(capture: RadarCapture) -> Iterator[str]:
    """Yield a sentence for the user about antenna pairs that were not measured."""
    measured = getattr(capture.aperture, "measured", None)
    if measured is not None and not measured.all():
        yield (
            f"{(~measured).sum()} of its {measured.size} pairs of antennas were not measured; "
            "images leave these out"
        )


def antenna_problems(samples: np.ndarray) -> Iterator[str]:
    """Yield sentences for the user about transmitters, receivers or scan positions that have no
    echo at any tone of a frame with echoes. samples [f, …]: those of the frame."""
    live = np.asarray(samples.any(axis=0))
    ways = {"positions": live}
    if live.ndim == 2:
        ways = {"transmitters": live.max(axis=1), "receivers": live.max(axis=0)}
    for name, alive in ways.items():
        if dead := np.flatnonzero(~alive).tolist():
            yield (
                f"{_numbered(dead, len(alive), name)} have no echo at any tone; check that they "
                "are connected"
            )


def _numbered(chosen: Sequence[int], count: int, name: str) -> str:
    """Say how many of `count` things are chosen, and their numbers."""
    numbers = np.sort(chosen)
    runs = np.split(numbers, 1 + np.flatnonzero(np.diff(numbers) > 1))
    spans = [f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs]
    some = ", ".join(spans[:NAMED]) + (", …" if len(spans) > NAMED else "")
    return f"{len(chosen)} of {count} {name} (numbers {some}, counted from 0)"


def live_extents_m(capture: RadarCapture, frame: int = 0) -> np.ndarray:
    """Compute how far the antennas with echoes extend: [3], along x, along y and across their
    longest direction, metres. All are 0 if no channel has an echo.

    The extents are those of the midpoints between transmitter and receiver of all channels that
    have an echo, since a scan of one antenna over the midpoints would resolve as well. Midpoints on
    one line have extent 0 across.
    """
    live = capture.samples[frame].any(axis=0).ravel()
    tx_m, rx_m = channel_ends(capture.aperture)
    middle_m = (tx_m + rx_m)[live, :2] / 2
    if len(middle_m) == 0:
        return np.zeros(3)
    _, axes = np.linalg.eigh(np.cov(middle_m.T, bias=True))
    return np.append(np.ptp(middle_m, axis=0), np.ptp(middle_m @ axes[:, 0]))


def copies_m(capture: RadarCapture, z_m: float) -> list[float]:
    """Compute after how much of x and of y an image at a depth z_m repeats, metres: λz/d.

    d is the usual step of the antennas with echoes in the first frame: of the sums of a channel's
    two positions, since its phase turns with both. Antennas in one place have no copies (inf).
    """
    live = capture.samples[0].any(axis=0).ravel()
    sums_m = np.sum(channel_ends(capture.aperture), axis=0)[live, :2]
    steps_m = [np.diff(np.unique(axis_m.round(PLACED))) for axis_m in sums_m.T]
    across_m = shortest_m(capture) * z_m
    return [across_m / float(np.median(d_m)) if len(d_m) else np.inf for d_m in steps_m]


def shortest_m(capture: RadarCapture) -> float:
    """Return the shortest wavelength of a capture, metres."""
    return capture.wave_speed_m_s / float(capture.frequencies_hz.max())


def unresolved_m(capture: RadarCapture, z_m: np.ndarray, frame: int = 0) -> np.ndarray:
    """Compute how much depth varies within one resolution cell of the antennas, metres, for depths
    z_m [ny, nx]: the cell's points at equal distance differ in depth by the sagitta.

    It is δ²/8z of a cell δ = λz/2D wide, where D is the extent of the antennas with echoes, and at
    most z. An axis along which the map has only one pixel does not count.
    """
    ny, nx = z_m.shape
    extents_m = live_extents_m(capture, frame)[[nx > 1, ny > 1, min(nx, ny) > 1]]
    per_m = lateral_cell_m(shortest_m(capture), extents_m, 1.0) ** 2 / 8
    return z_m * min(1.0, float(np.max(per_m, initial=0.0)))


def _unit(tone: np.ndarray) -> np.ndarray:
    """Return a tone's samples [...] divided by their largest magnitude."""
    return tone / np.abs(tone).max()
