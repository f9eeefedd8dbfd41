"""Checks that a target and what was estimated with it agree."""

from __future__ import annotations

import numpy as np

from calibration.array.model import Echoes, State
from calibration.array.prior import Settings, misplaced_m, shape_sigma_m
from calibration.target.description import Target
from radar.imaging.cpu.exact import path_lengths
from radar.support.errors import HandbenchError

SINGLE = 1e-5  # samples in single precision carry no less noise than this part of their amplitude
GUARD_CELLS = 3  # of the sweep's range resolution, about the balls


def check(state: State, left: float, target: Target, settings: Settings, source: str) -> None:
    """Refuse a target that explains too little of its echoes (left: see `left_over`), and errors beyond what was
    expected."""
    if left > 1 - settings.least_explained:
        raise HandbenchError(
            f"{source}: the target explains {100 * (1 - left):.1f} % of its echoes' energy, expected at least "
            f"{100 * settings.least_explained:.0f} %; check the target's description and that nothing else echoes there"
        )
    off_m = misplaced_m(state.centres_m, target)
    worst = int(np.linalg.norm(off_m, axis=1).argmax())
    if np.linalg.norm(off_m[worst]) > 2 * settings.most_sigmas * shape_sigma_m(target):
        raise HandbenchError(
            f"{source}: the target's element {worst + 1} is {1e3 * np.linalg.norm(off_m[worst]):.2f} mm from where its "
            f"description has it, expected about {1e3 * shape_sigma_m(target):.2f} mm; measure the target again"
        )
    offsets_m = np.sqrt(np.mean(np.concatenate([state.tx.offset_m, state.rx.offset_m]) ** 2, axis=0))
    if offsets_m.max() > settings.most_sigmas * settings.position_sigma_m:
        raise HandbenchError(
            f"{source}: the antennas would be {1e6 * offsets_m.max():.0f} µm off, expected about "
            f"{1e6 * settings.position_sigma_m:.0f} µm; check the target's description, or expect larger errors"
        )


def left_over(samples: np.ndarray, state: State, echoes: Echoes) -> float:
    """Part of the target's energy in samples [t, r, f] that the state does not explain, noise deducted: at least what
    the noise leaves uncertain.

    Seen over the path through the target's middle, the balls lie within a few range cells; the noise is the median of
    the cells beyond.
    """
    middle_m = state.centres_m.mean(axis=0)
    path_m = path_lengths(state.array, middle_m)
    cell_m = 2 * np.pi / np.ptp(echoes.wavenumber)
    reach_m = 2 * np.linalg.norm(state.centres_m - middle_m, axis=1).max()
    cells = np.fft.fftfreq(samples.shape[-1], 1 / samples.shape[-1])
    near = np.abs(cells) <= reach_m / cell_m + GUARD_CELLS
    profiles = np.zeros((2, samples.shape[-1]))
    for t, terms in enumerate(echoes.terms(state)):
        focus = np.exp(1j * np.multiply.outer(path_m[t], echoes.wavenumber))
        for profile, what in zip(profiles, (samples[t], samples[t] - terms.sum(axis=1)), strict=True):
            profile += (np.abs(np.fft.fft(what * focus, axis=-1)) ** 2).sum(axis=0)
    noise = float(np.median(profiles[1][~near])) if (~near).any() else 0.0
    whole, rest = ((profile[near] - noise).sum() for profile in profiles)
    told = max(noise * np.sqrt(near.sum() / path_m.size), SINGLE**2 * whole)  # less than this cannot be told from noise
    return float(max(rest, told) / whole)
