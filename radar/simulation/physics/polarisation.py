"""Polarisation of echoes over two places: the field of short dipoles, reflected by each mirror at its own angle.

A mirror whose normal is that between a ray and where it goes on, h = (k' − k)/|k' − k|, keeps the field across the
plane of incidence, s = k × h, and turns the one along it, each times Γ of its polarisation; Γ of the latter is here
that of the component along the surface, so that both agree at normal incidence. At 45°, where fingers mirror onto each
other, Γ² of skin is 2.8 dB above that of normal incidence for the one and 4.0 dB below for the other.
"""

from __future__ import annotations

import numba
import numpy as np

from radar.imaging.cpu.steering import FAST
from radar.simulation.physics.bounces import Tubes
from radar.simulation.physics.vectors import ahead, cross, direction, dot, minus, vec

LEAST_SINE = 1e-6  # of the angle of incidence, below which every plane is one of incidence


def tube_factors(
    tubes: Tubes, tx_m: np.ndarray, dipole: np.ndarray, ratios: np.ndarray, layers: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """The factors by which polarisation, angles and caustics change tubes' amplitudes, as in the direction in which the
    second place mirrors them: complex64 [n]; 1 where metal is met across the plane of incidence.

    dipole [3]: both antennas'; ratios [layers, 2, cosines]: Γ of each layer at even steps of the cosine of incidence
    from 0 to 1, over that at normal incidence, across the plane of incidence first; layers: of the first and the
    second place of each tube [n]."""
    factors = np.zeros(len(tubes.face), np.complex64)
    _fill(tubes, tx_m, np.asarray(dipole, float), ratios, *layers, factors)
    return factors


@numba.njit(**FAST)
def _fill(tubes, tx_m, dipole, ratios, first_layer, second_layer, factors):  # type: ignore[no-untyped-def]
    for n in range(len(factors)):
        if tubes.root_m2[n] == 0:
            continue
        start, end, normal = vec(tubes.start_m[n]), vec(tubes.end_m[n]), vec(tubes.normal[n])
        first = direction(minus(start, vec(tx_m[tubes.transmitter[n]])))[0]
        between = direction(minus(end, start))[0]
        last = ahead(between, -2 * dot(between, normal), normal)
        sent, heard = _across(dipole, first), _across(dipole, last)
        # Γ is complex, vectors are real: each part of the field by itself.
        one_s, one_p, across, turned = _reflected(sent, first, between, ratios[first_layer[n]])
        s_s, s_p, s_across, s_turned = _reflected(across, between, last, ratios[second_layer[n]])
        p_s, p_p, p_across, p_turned = _reflected(turned, between, last, ratios[second_layer[n]])
        factor = one_s * (s_s * dot(s_across, heard) + s_p * dot(s_turned, heard))
        factor += one_p * (p_s * dot(p_across, heard) + p_p * dot(p_turned, heard))
        for _ in range(tubes.caustics[n]):
            factor *= 1j
        factors[n] = factor


@numba.njit(inline="always")
def _across(dipole, ray):  # type: ignore[no-untyped-def]
    """The dipole's unit field on a ray."""
    whole = vec(dipole)
    return direction(ahead(whole, -dot(whole, ray), ray))[0]


@numba.njit(**FAST)
def _reflected(field, before, after, ratio):  # type: ignore[no-untyped-def]
    """Γ of both polarisations, and what they multiply of the field of a ray along `before` once it goes on along
    `after`: the part across the plane of incidence, and the part along it, turned."""
    normal = direction(minus(after, before))[0]
    across, sine = direction(cross(before, normal))
    if sine < LEAST_SINE:
        axis = (1.0, 0.0, 0.0) if abs(normal[0]) < 0.6 else (0.0, 1.0, 0.0)
        across = direction(cross(normal, axis))[0]
    place = min(max(dot(after, normal), 0.0), 1.0) * (ratio.shape[1] - 1)
    below = min(int(place), ratio.shape[1] - 2)
    share = place - below
    s = (1 - share) * ratio[0, below] + share * ratio[0, below + 1]
    p = (1 - share) * ratio[1, below] + share * ratio[1, below + 1]
    zero = (0.0, 0.0, 0.0)
    kept = ahead(zero, dot(field, across), across)
    turned = ahead(zero, -dot(field, cross(before, across)), cross(after, across))
    return s, p, kept, turned
