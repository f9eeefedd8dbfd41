"""Polarisation of echoes over two places: the field of short dipoles, reflected by each mirror at its own angle.

A mirror whose normal is that between a ray and where it goes on, h = (k' − k)/|k' − k|, keeps the field across the
plane of incidence, s = k × h, and turns the one along it, each times Γ of its polarisation; Γ of the latter is here
that of the component along the surface, so that both agree at normal incidence. At 45°, where fingers mirror onto each
other, Γ² of skin is 2.8 dB above that of normal incidence for the one and 4.0 dB below for the other.
"""

from __future__ import annotations

import numpy as np

from radar.simulation.physics.bounces import Tubes
from radar.simulation.physics.facets import unit

LEAST_SINE = 1e-6  # of the angle of incidence, below which every plane is one of incidence


def tube_factors(tubes: Tubes, tx_m: np.ndarray, dipole: np.ndarray, ratios: tuple[np.ndarray, ...]) -> np.ndarray:
    """The factors by which polarisation and angles change tubes' amplitudes, as in the direction in which the second
    place mirrors them: complex64 [n]; 1 where metal is met across the plane of incidence.

    dipole [3]: both antennas'; ratios: Γ [2, cosines] of either place at even steps of the cosine of incidence from 0
    to 1, over that at normal incidence, across the plane of incidence first."""
    first, between = unit(tubes.start_m - tx_m[tubes.transmitter]), unit(tubes.end_m - tubes.start_m)
    last = between - 2 * (between * tubes.normal).sum(axis=1)[:, None] * tubes.normal
    field = _reflected(_across(dipole, first), first, between, ratios[0])
    field = _reflected(field, between, last, ratios[1])
    return np.asarray((field * _across(dipole, last)).sum(axis=1).astype(np.complex64))


def _across(dipole: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The dipole's unit field [n, 3] on rays [n, 3]."""
    return unit(dipole - (along @ dipole)[:, None] * along)


def _reflected(field: np.ndarray, before: np.ndarray, after: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """The field [n, 3] of rays along unit vectors before [n, 3] once they go on along `after`."""
    normal = unit(after - before)
    across = np.cross(before, normal)
    sine = np.linalg.norm(across, axis=1)
    any_across = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    across = unit(np.where(sine[:, None] > LEAST_SINE, across, any_across))
    cosines = np.linspace(0, 1, ratio.shape[1])
    s, p = (np.interp((after * normal).sum(axis=1), cosines, part)[:, None] for part in ratio)
    kept = (field * across).sum(axis=1)[:, None] * across
    turned = (field * np.cross(before, across)).sum(axis=1)[:, None] * np.cross(after, across)
    return np.asarray(s * kept - p * turned)
