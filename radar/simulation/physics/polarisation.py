"""Polarisation of echoes over several places: the field of short dipoles is reflected by each
mirror at its own angle of incidence.

At a mirror that turns a ray from direction k to k', the normal is h = (k' − k)/|k' − k|. The field
component across the plane of incidence, along s = k × h, keeps its direction; the component in that
plane turns with the ray. Each is multiplied by the Γ of its polarisation; for the second one, Γ is
that of the component along the surface, so that both agree at normal incidence. At 45°, where
fingers mirror onto each other, Γ² of skin is 2.8 dB above that of normal incidence for the first
component and 4.0 dB below for the second.
"""

from __future__ import annotations

import numpy as np

from handbench.radar.simulation.physics.bounces import Tubes
from handbench.radar.simulation.physics.vectors import ahead, cross, direction, dot, minus, vec
from handbench.support.compiled import FAST, njit

LEAST_SINE = 1e-6  # of the angle of incidence, below which every plane is one of incidence


def tube_factors(
    tubes: Tubes, tx_m: np.ndarray, dipole: np.ndarray, ratios: np.ndarray, layers: np.ndarray
) -> np.ndarray:
    """Compute the factors by which polarisation, angles of incidence and caustics change the
    amplitudes of ray tubes: complex64 [n]. For metal with the field across every plane of incidence
    they are 1. The direction of observation is that in which the last place would mirror the tube.

    dipole [3]: direction of both antennas' electric field; ratios [layers, 2, cosines]: reflection
    over that at normal incidence, for the field across the plane of incidence and in it, at evenly
    spaced cosines of incidence from 0 to 1 (`oblique_ratios`); layers [n, b + 1]: surface layer at
    each place that a tube meets.
    """
    factors = np.zeros(len(tubes.patch), np.complex64)
    _fill(tubes, tx_m, np.asarray(dipole, float), ratios, layers, factors)
    return factors


@njit(**FAST)
def _fill(tubes, tx_m, dipole, ratios, layers, factors):  # type: ignore[no-untyped-def]
    for n in range(len(factors)):
        if tubes.root_m2[n] == 0:
            continue
        places, normal = tubes.points_m[n], vec(tubes.normal[n])
        before = direction(minus(vec(places[0]), vec(tx_m[tubes.transmitter[n]])))[0]
        x, y, z = _across(dipole, before)
        field = (complex(x), complex(y), complex(z))
        for b in range(len(places) - 1):
            after = direction(minus(vec(places[b + 1]), vec(places[b])))[0]
            field = _reflected(field, before, after, ratios[layers[n, b]])
            before = after
        last = ahead(before, -2 * dot(before, normal), normal)
        factor = dot(_reflected(field, before, last, ratios[layers[n, -1]]), _across(dipole, last))
        for _ in range(tubes.caustics[n]):
            factor *= 1j
        factors[n] = factor


@njit(inline="always")
def _across(dipole, ray):  # type: ignore[no-untyped-def]
    """Return the direction of the electric field that a short dipole radiates along a unit ray: the
    unit vector of the dipole's component across the ray."""
    whole = vec(dipole)
    return direction(ahead(whole, -dot(whole, ray), ray))[0]


@njit(**FAST)
def _reflected(field, before, after, ratio):  # type: ignore[no-untyped-def]
    """Return the field [3] of a ray after a mirror that turns it from the direction `before` to
    `after`. ratio [2, cosines]: reflection, by cosine of incidence, of the field component across
    the plane of incidence and of the component in it."""
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
    kept = ahead((0j, 0j, 0j), s * dot(field, across), across)
    return ahead(kept, -p * dot(field, cross(before, across)), cross(after, across))
