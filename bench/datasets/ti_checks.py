"""Mistakes in the chirp profile of a raw capture, found in its echoes.

The samples of a right profile have these properties, which a wrong one destroys:

- echoes have positive beat frequencies, and the negative ones hold noise (lanes, order of I and Q);
- a chirp is smooth, and the phase jumps where the next begins (samples);
- the same transmitter and receiver have the same echoes throughout a frame (transmitters,
  receivers, loops);
- neighbouring antennas differ by the phases of directions (order of the transmitters).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from handbench.bench.datasets.ti_directions import LEAKED, focus, most_focused, moves
from handbench.bench.datasets.ti_profile import CHIRPS, ChirpProfile, read_profile
from handbench.bench.datasets.ti_samples import decode, frame_numbers, read_numbers, unpack
from handbench.support.caller import settings

MOST = 2**21  # numbers that are checked
# share of the power at negative beat frequencies, of a right profile at most, of a wrong at least
RIGHT_SHARE, WRONG_SHARE = 0.08, 0.15
PREDICTED = 12  # samples from which the next is predicted
SHORTEST = 16  # chirp, samples
# energy of a step, over the mean, where a chirp begins at least; elsewhere at most
SEAM, SMOOTH = 3.0, 1.85
CHANGED = 2.0  # step of the echoes from frame to frame, at least, over the largest within one
PRIMES = (2, 3, 5, 7)  # a chirp is that many times shorter than one taken for it
STILL = 0.12  # variance among repetitions of a scene that stands still, over its power, at most
# variance among repetitions over that of the profile as it is: of a right profile at most; by how
# much that of an equally good one may be higher: always, times the root of the samples, and of the
# difference to a wrong one
REPEATED, EQUAL, EQUAL_BY_CHANCE, NEARLY = 0.5, 0.01, 1.5, 0.05

Change = dict[str, Any]
Found = tuple[list[Change], str] | None


def raw_warnings(source: Path) -> list[str]:
    """Return warnings that the echoes in a raw capture's folder contradict its profile. Raises
    HandbenchError if it cannot be read."""
    profile = read_profile(source, {})
    numbers = read_numbers(source, profile)
    decode(numbers, profile, str(source))  # refuses what is no whole frames
    return list(profile_warnings(source, numbers, profile))


def profile_warnings(source: Path, numbers: np.ndarray, profile: ChirpProfile) -> Iterator[str]:
    """Yield a warning if the echoes contradict their profile and agree with another one: what they
    show, and the settings that give that profile.

    Args:
        source: folder that may have the antennas' places; without them, and without a board, the
            order of the transmitters is not checked.
        numbers: a DCA1000's, int16 [n], of whole frames.
        profile: as the numbers are read.
    """
    if found := mistake(source, numbers, profile):
        changes, shown = found
        yield f"{shown}; the profile may be wrong: {' or '.join(map(settings, changes))} fits"


def mistake(source: Path, numbers: np.ndarray, profile: ChirpProfile) -> Found:
    """Find the first mistake in a profile: ([fields as they should be; several if the echoes do not
    distinguish between them], what the echoes show); None if there is none. source: the folder;
    numbers, int16 [n]: those in its .bin files; profile: as the folder states it."""
    frame = frame_numbers(profile)
    frames = min(len(numbers), MOST) // frame
    if frames < len(numbers) // frame:  # a power of 2, so that twice as large frames fit, too
        frames = 1 << max(frames.bit_length() - 1, 0)
    numbers = numbers[: frames * frame]
    if profile.samples < SHORTEST or not numbers.any():
        return None
    checks = (_lanes, _samples, _channels, _order)
    return next(filter(None, (check(source, numbers, profile) for check in checks)), None)


def _lanes(source: Path, numbers: np.ndarray, profile: ChirpProfile) -> Found:
    """Compare lanes and orders by the share of power at negative beat frequencies."""
    if profile.real:
        return None
    share = {
        (lanes, order): _negative_share(numbers, _with(profile, {"lanes": lanes, "order": order}))
        for lanes in ((16,) if profile.lanes == 16 else (2, 4))
        for order in ("IQ", "QI")
    }
    given, best = (profile.lanes, profile.order), min(share, key=lambda key: share[key])
    if share[given] < WRONG_SHARE or share[best] > RIGHT_SHARE:
        return None
    change = {
        name: right
        for name, right, wrong in zip(("lanes", "order"), best, given, strict=True)
        if right != wrong
    }
    shown = f"{100 * share[given]:.0f} % of the echoes' power has negative beat frequencies"
    return [change], f"{shown}, {100 * share[best]:.0f} % with other {' and '.join(change)}"


def _negative_share(numbers: np.ndarray, profile: ChirpProfile) -> float:
    """Compute the share of the power of beats at negative frequencies, all near 0 left out."""
    n, values = profile.samples, unpack(numbers[: len(numbers) // 32 * 32], profile)
    chirps = values[: len(values) // n * n].reshape(-1, n, values.shape[1])
    spectrum = np.fft.fft(chirps * np.hanning(n)[:, None], axis=1)
    power = (np.abs(spectrum) ** 2).mean(axis=(0, 2))
    power = np.clip(power - np.median(power), 0, None)[LEAKED + 1 : n - LEAKED]  # without noise
    return float(power[len(power) // 2 :].sum() / power.sum()) if power.any() else 0.0


def _samples(source: Path, numbers: np.ndarray, profile: ChirpProfile) -> Found:
    """Find the samples of a chirp by the steps between chirps: a sample that those before do not
    predict."""
    values, n = unpack(numbers, profile), profile.samples
    before = np.concatenate([values[-PREDICTED:], values])
    windows = sliding_window_view(before, PREDICTED, axis=0)[:-1].reshape(-1, PREDICTED)
    wanted = values.reshape(-1)
    weights = np.linalg.lstsq(windows.conj().T @ windows, windows.conj().T @ wanted, rcond=1e-6)[0]
    errors = np.abs(wanted - windows @ weights).reshape(values.shape) ** 2
    chirps = profile.loops * len(profile.transmitters)
    chirps *= len(profile.receivers) if profile.lanes == 2 else 1
    for other in _divisors(len(values) // chirps):
        long_enough = other >= SHORTEST and other % 2 == 0 and other != n
        if long_enough and _begin(errors.sum(axis=1), n, other):
            return [{"samples": other}], f"chirps begin every {other} samples, not every {n}"
    return None


def _begin(energy: np.ndarray, given: int, other: int) -> bool:
    """True if chirps of `other` samples begin where steps of this energy [sample] are high: at its
    multiples, also where those of twice, three times … as many samples do not begin, and nowhere
    else at those of `given`."""
    at, place = energy[::other], np.arange(-(-len(energy) // other))
    only_given = energy[::given][np.arange(0, len(energy), given) % other > 0]
    if len(at) <= PRIMES[-1]:
        return False
    place_in = np.arange(len(energy))
    inside = energy[(place_in % given >= PREDICTED) & (place_in % other >= PREDICTED)]
    usual, high = inside.mean(), min(at[place % k > 0].mean() for k in PRIMES)
    smooth = not len(only_given) or only_given.mean() < min(SMOOTH * usual, high / 2)
    return bool(high > SEAM * usual and smooth)


def _channels(source: Path, numbers: np.ndarray, profile: ChirpProfile) -> Found:
    """Find the receivers and the order of the transmitters in which the same channel always has the
    same echoes."""
    values, n = unpack(numbers, profile), profile.samples
    used = tuple((np.flatnonzero(values.any(axis=0)) + 1).tolist())
    if profile.lanes > 2 and used != profile.receivers:
        return [{"receivers": used}], f"lanes {', '.join(map(str, used))} have samples"
    chirps = values.reshape(-1, n * values.shape[1])  # of a receiver, or of all
    tried = []
    for change in ({}, *_other_channels(profile, len(chirps))):
        other = _with(profile, change)
        channel = _channels_of(len(chirps), other)
        channels = int(channel.max()) + 1
        for frame in {_frame_chirps(other), len(chirps)}:
            group = np.arange(len(chirps)) // frame * channels + channel
            groups = len(np.unique(group))
            if 2 * groups <= len(chirps):
                tried.append(_Trial(change, channels, groups, _variance(chirps, group)))
    if not tried or tried[0].change:
        return None
    lowest = min(trial.variance for trial in tried)
    given = min(trial.variance for trial in tried if not trial.change)
    equal = lowest * (1 + EQUAL + EQUAL_BY_CHANCE / chirps.size**0.5)
    repeats = given <= equal
    if lowest > (STILL if repeats else REPEATED * given):
        return None
    equal = equal if repeats else max(equal, lowest + NEARLY * (given - lowest))
    good = [
        trial
        for trial in tried
        if _in_steps(chirps, profile, trial.change)
        and trial.variance <= (REPEATED * given if trial.change.keys() == {"loops"} else equal)
    ]
    # as few channels as explain the echoes; if those of the profile do not, as few changes of the
    # scene, with as few changed fields as possible
    size = [trial.channels if repeats else trial.groups for trial in good]
    good = [trial for trial, its in zip(good, size, strict=True) if its == min(size)]
    fewest: dict[int, int] = {}
    for trial in good:
        fields = fewest.get(trial.channels, len(trial.change))
        fewest[trial.channels] = min(fields, len(trial.change))
    best = [trial.change for trial in good if len(trial.change) == fewest[trial.channels]]
    if not best or {} in best:
        return None
    shown = f"repetitions of a channel differ by {100 * given:.2g} % of their power"
    if repeats:
        shown = "several channels have the same echoes"
    return most_focused(source, numbers, profile, best), shown


def _in_steps(chirps: np.ndarray, profile: ChirpProfile, change: Change) -> bool:
    """True unless a change divides the time into other frames or blocks, without a step of the
    echoes between them: a scene may move all the time."""
    other = _with(profile, change)
    sent, kinds = len(other.transmitters), len(set(other.transmitters))
    if not change or (sent == kinds and change.keys() != {"loops"}):
        return True
    apart = _frame_chirps(other) // (other.loops * sent)
    unit, period = (apart, sent // kinds) if sent > kinds else (apart * sent, other.loops)
    units = chirps.reshape(-1, unit * chirps.shape[1])
    steps = (np.abs(np.diff(units, axis=0)) ** 2).sum(axis=1)
    between, inside = steps[period - 1 :: period], np.delete(steps, np.s_[period - 1 :: period])
    if not len(between) or not len(inside):
        return False
    return bool(between.min() > CHANGED * inside.max())


@dataclass(frozen=True, eq=False)
class _Trial:
    """A profile that was tried: the changed fields, its channels, the groups of chirps that should
    be equal, and the variance within them over their power."""

    change: Change
    channels: int
    groups: int
    variance: float


def _other_channels(profile: ChirpProfile, chirps: int) -> Iterator[Change]:
    """Yield changes of the receivers, of the loops, and of the number and the order of the
    transmitters that divide so many chirps into whole frames."""
    known = list(dict.fromkeys(profile.transmitters))
    in_turn = len(known) == len(profile.transmitters)
    known += [number for number in (1, 2, 3) if number not in known]
    sent = len(profile.transmitters) * profile.loops
    changes: list[Change] = []
    if profile.lanes == 2:
        changes += [{"receivers": tuple(range(1, count + 1))} for count in range(1, 5)]
    for count in (1, 2, 3):
        if in_turn:
            changes.append({"transmitters": tuple(known[:count])})
        if sent % count == 0:
            changes.append({"transmitters": tuple(known[:count]), "loops": sent // count})
            if sent <= CHIRPS:
                block = tuple(np.repeat(known[:count], sent // count).tolist())
                changes.append({"transmitters": block, "loops": 1})
    changes += [{"loops": loops} for loops in _divisors(chirps * profile.loops // sent)]
    given = _frame_chirps(profile)
    for change in changes:
        other = _with(profile, change)
        longer = change.keys() == {"loops"} and _frame_chirps(other) % given == 0
        if other != profile and chirps % _frame_chirps(other) == 0 and not longer:
            yield change


def _variance(chirps: np.ndarray, group: np.ndarray) -> float:
    """Compute the variance of chirps [chirp, sample] of the same group [chirp] over their power."""
    order = np.argsort(group, kind="stable")
    _, starts, sizes = np.unique(group[order], return_index=True, return_counts=True)
    sums = np.add.reduceat(chirps[order], starts, axis=0)
    power = float((np.abs(chirps) ** 2).sum())
    common = float(((np.abs(sums) ** 2).sum(axis=1) / sizes).sum())
    return (1 - common / power) / (1 - len(starts) / len(chirps))


def _frame_chirps(profile: ChirpProfile) -> int:
    """Count the chirps of a frame, those of two lanes' receivers separately."""
    apart = len(profile.receivers) if profile.lanes == 2 else 1
    return profile.loops * len(profile.transmitters) * apart


def _channels_of(number: int, profile: ChirpProfile) -> np.ndarray:
    """Return the channel of each of a number of chirps, those of receivers one after the other."""
    apart = len(profile.receivers) if profile.lanes == 2 else 1
    chirp = np.arange(number)
    sent = np.unique(profile.transmitters, return_inverse=True)[1]
    return sent[chirp // apart % len(sent)] * apart + chirp % apart


def _order(source: Path, numbers: np.ndarray, profile: ChirpProfile) -> Found:
    """Find the order of the transmitters by how well the echoes focus in directions."""
    sent = sorted(set(profile.transmitters))
    if len(profile.receivers) < 3 or not 1 < len(sent) <= 3:
        return None
    if moves(numbers, profile) or focus(source, numbers, profile) is None:
        return None
    orders = [dict(zip(sent, order, strict=True)) for order in permutations(sent)]
    changes: list[Change] = [
        {"transmitters": tuple(order[number] for number in profile.transmitters)}
        for order in orders
    ]
    best = most_focused(source, numbers, profile, changes)
    if changes[0] in best:
        return None
    return best, "in another order of the transmitters the echoes' power focuses better"


def _with(profile: ChirpProfile, change: Change) -> ChirpProfile:
    """Return the profile with other values of some fields."""
    return profile.model_copy(update=change)


def _divisors(number: int) -> list[int]:
    """Return the divisors of a number, rising."""
    low = [k for k in range(1, int(number**0.5) + 1) if number % k == 0]
    return sorted({*low, *(number // k for k in low)})
