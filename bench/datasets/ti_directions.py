"""How well the echoes of a raw capture focus in directions, with the antennas as its chirp profile
orders them."""

from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.ti_boards import antennas
from handbench.bench.datasets.ti_profile import ChirpProfile
from handbench.bench.datasets.ti_samples import decode
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.support.errors import HandbenchError

LEAKED = 2  # bins into which a window of Hann leaks what is at 0
DRIFT = 0.003  # of the power, of a scene that stands still, at most
# focused power of a better order less that of the order as it is, and the ratio of what is left
FOCUSED, UNFOCUSED = 0.04, 1.5
DIRECTIONS = 41  # sines of directions that are tried, along each axis
STRONGEST = 8  # range bins in whose directions the antennas are compared


def moves(numbers: np.ndarray, profile: ChirpProfile) -> bool:
    """True if a channel's echoes drift during a frame, which turns the phases between transmitters:
    repetitions differ from their mean by more than from each other."""
    beat = decode(numbers, profile, "")
    order = np.argsort(profile.transmitters, kind="stable")
    order = order.reshape(len(set(profile.transmitters)), -1)
    repeated = beat[:, :, order].swapaxes(1, 2)  # [frame, transmitter, loop, chirp, receiver, n]
    repeated = repeated.reshape(*repeated.shape[:2], -1, *beat.shape[-2:])
    if repeated.shape[2] == 1:
        return False
    spread = repeated.var(axis=2, ddof=1).mean()
    steps = (np.abs(np.diff(repeated, axis=2)) ** 2).mean() / 2
    return bool(spread - steps > DRIFT * (np.abs(repeated) ** 2).mean())


def most_focused(
    source: Path, numbers: np.ndarray, profile: ChirpProfile, changes: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return those of the changes with which the echoes focus best; all if no places are known."""
    changes = [change for k, change in enumerate(changes) if change not in changes[:k]]
    shares = [
        focus(source, numbers, profile.model_copy(update=change)) or 0.0 for change in changes
    ]
    most = max(shares)
    return [
        change
        for change, share in zip(changes, shares, strict=True)
        if most < share + FOCUSED or 1 - share < UNFOCUSED * (1 - most)
    ]


def focus(source: Path, numbers: np.ndarray, profile: ChirpProfile) -> float | None:
    """Compute the share of the power in the strongest range bins that comes from one direction
    each; None if the antennas' places are not known."""
    sent = np.unique(profile.transmitters)
    try:
        places_m, gains = antennas(source, profile, sent)
        beat = decode(numbers, profile, str(source))[0].mean(axis=0)
    except HandbenchError:
        return None
    order = np.array([np.equal(profile.transmitters, number) for number in sent], float)
    channels = np.tensordot(order, beat, axes=1) / (1.0 if gains is None else gains[..., None])
    n = profile.samples
    ranges = np.fft.fft(channels * np.hanning(n))[..., LEAKED + 1 : n // 2].reshape(
        -1, n // 2 - LEAKED - 1
    )
    power = (np.abs(ranges) ** 2).sum(axis=0)
    ranges = ranges[:, np.argsort(power)[-STRONGEST:]]
    place_m = (places_m["tx_m"][:, None] + places_m["rx_m"]).reshape(-1, 3)
    sines = np.linspace(-1, 1, DIRECTIONS)
    across, up = np.meshgrid(sines, sines)
    directions = np.stack([across, up], axis=-1)[across**2 + up**2 <= 1]
    waves = 2 * np.pi * profile.tones_hz().mean() / SPEED_OF_LIGHT_M_S
    # a path is shorter by (place · direction): of the beat, whose phase grows with the path
    beams = np.exp(1j * waves * directions @ place_m[:, :2].T) @ ranges
    best = (np.abs(beams) ** 2).max(axis=0) / len(place_m)
    return float(best.sum() / (np.abs(ranges) ** 2).sum())
