"""Polarisation of echoes over several places: the field of short dipoles is reflected by each
mirror at its own angle of incidence.

At a mirror that turns a ray from direction k to k', the normal is h = (k' − k)/|k' − k|. The field
component across the plane of incidence, along s = k × h, keeps its direction; the component in that
plane turns with the ray. Each is multiplied by the Γ of its polarisation; for the second one, Γ is
that of the component along the surface, so that both agree at normal incidence. At 45°, where
fingers mirror onto each other, Γ² of skin is 2.8 dB above that of normal incidence for the first
component and 4.0 dB below for the second.

A round mirror reflects by Pekeris' function in place of geometrical optics
(`creeping.round_ratios`).
"""

from __future__ import annotations

import numpy as np

from handbench.radar.simulation.physics.bounces import Tubes
from handbench.radar.simulation.physics.creeping import ROUNDEST
from handbench.radar.simulation.physics.vectors import ahead, cross, direction, dot, minus, vec
from handbench.support.compiled import FAST, INNER, njit

LEAST_SINE = 1e-6  # of the angle of incidence, below which every plane is one of incidence


def tube_factors(
    tubes: Tubes,
    tx_m: np.ndarray,
    dipole: np.ndarray,
    ratios: np.ndarray,
    layers: np.ndarray,
    wavenumber: float,
) -> np.ndarray:
    """Compute the factors by which polarisation, angles of incidence and caustics change the
    amplitudes of ray tubes: complex64 [n]. For flat or hollow metal with the field across every
    plane of incidence they are 1. The direction of observation is that in which the last place
    would mirror the tube.

    dipole [3]: direction of both antennas' electric field; ratios [layers, 2, bends, cosines]:
    reflection over that of a plane at normal incidence (`round_ratios`); layers [n, b + 1]: surface
    layer at each place that a tube meets; wavenumber: in rad/m.
    """
    factors = np.zeros(len(tubes.patch), np.complex64)
    _fill(tubes, tx_m, np.asarray(dipole, float), ratios, layers, wavenumber, factors)
    return factors


@njit(**FAST)
def _fill(  # type: ignore[no-untyped-def]
    tubes, tx_m, dipole, ratios, layers, wavenumber, factors
):
    for n in range(len(factors)):
        if tubes.root_m2[n] == 0:
            continue
        places, normal = tubes.points_m[n], vec(tubes.normal[n])
        before = direction(minus(vec(places[0]), vec(tx_m[tubes.transmitter[n]])))[0]
        x, y, z = _across(dipole, before)
        field = (complex(x), complex(y), complex(z))
        for b in range(len(places)):
            after = ahead(before, -2 * dot(before, normal), normal)
            if b + 1 < len(places):
                after = direction(minus(vec(places[b + 1]), vec(places[b])))[0]
            bend = np.cbrt(2 * max(tubes.bend_per_m[n, b], 0.0) / wavenumber)
            field, before = _reflected(field, before, after, bend, ratios[layers[n, b]]), after
        factor = dot(field, _across(dipole, before))
        for _ in range(tubes.caustics[n]):
            factor *= 1j
        factors[n] = factor


@njit(inline="always")
def _across(dipole, ray):  # type: ignore[no-untyped-def]
    """Return the direction of the electric field that a short dipole radiates along a unit ray: the
    unit vector of the dipole's component across the ray."""
    whole = vec(dipole)
    return direction(ahead(whole, -dot(whole, ray), ray))[0]


@njit(**INNER)
def _reflected(field, before, after, bend, ratio):  # type: ignore[no-untyped-def]
    """Return the field [3] of a ray after a mirror that turns it from the direction `before` to
    `after`. bend: 1/m = (2/ka)^{1/3} of the mirror, 0 if it is not convex; ratio [2, bends,
    cosines]: reflection of the field component across the plane of incidence and of the component
    in it (`round_ratios`)."""
    normal = direction(minus(after, before))[0]
    across, sine = direction(cross(before, normal))
    if sine < LEAST_SINE:
        axis = (1.0, 0.0, 0.0) if abs(normal[0]) < 0.6 else (0.0, 1.0, 0.0)
        across = direction(cross(normal, axis))[0]
    row, up = _between(bend / ROUNDEST, ratio.shape[1])
    column, on = _between(dot(after, normal), ratio.shape[2])
    s, p = _mean(ratio[0], row, up, column, on), _mean(ratio[1], row, up, column, on)
    kept = ahead((0j, 0j, 0j), s * dot(field, across), across)
    return ahead(kept, -p * dot(field, cross(before, across)), cross(after, across))


@njit(inline="always")
def _between(share, count):  # type: ignore[no-untyped-def]
    """Return the place of a share of the way along evenly spaced values: (index of the value below,
    share of the way from there to the next)."""
    place = min(max(share, 0.0), 1.0) * (count - 1)
    below = min(int(place), count - 2)
    return below, place - below


@njit(inline="always")
def _mean(table, row, up, column, on):  # type: ignore[no-untyped-def]
    """Interpolate in a table [rows, columns] between a row and column and the next ones."""
    below = (1 - on) * table[row, column] + on * table[row, column + 1]
    above = (1 - on) * table[row + 1, column] + on * table[row + 1, column + 1]
    return (1 - up) * below + up * above
