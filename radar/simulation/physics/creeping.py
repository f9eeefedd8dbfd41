"""Waves that creep around the round edges of a body, in addition to the diffraction of a knife
edge.

Behind an edge with a radius of curvature a along the ray, the field over that without the body is a
knife edge's and

    −m √(2/kL) e^{−jπ/4} p*(mθ) e^{−jkδ},   m = (ka/2)^{1/3},   L = ss'/(s + s'),

with θ the angle by which the ray bends, s and s' its lengths before and behind the edge, and δ its
detour (Pathak, Radio Sci. 14 (1979) 419); the detour of all waves is longer by the arc, aθ³/6. By
the stationary phase along a straight edge, √(2πL/k) e^{−jπ/4}, this is the sum over the edge's
elements dl of −(m/√π) p*(mθ) dl/L e^{−jkδ}. Pekeris' function,

    p*(ξ) = 1/√π ∫ (V' − qV)/(W₂' − qW₂) e^{−jξτ} dτ,

has q = −jm/η for a field along the edge and −jmη for one across, with η the impedance of the
surface over that of free space: 0 for metal. It is continued beyond the shadow's edge, θ < 0, to
where it becomes the ray that the edge mirrors.

The same function gives the reflection of a convex mirror at the cosine cos θ of incidence (Pathak,
eq. 3, far from the shadow's edge),

    R = −√(−4/ξ) e^{−jξ³/12 − jπ/4} (p*(ξ) − 1/(2√π ξ)),   ξ = −2m cos θ,

which is that of a plane for ξ → −∞. It turns the phase at a metal finger by 5° for 45° of
incidence and by 8° for 57°, in opposite senses for the two polarisations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import airy

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.physics.facets import unit, vertex_normals
from handbench.radar.simulation.physics.reflection import echo_reflections, reflections
from handbench.radar.simulation.physics.vectors import cross, direction, minus, vec
from handbench.radar.simulation.scene import Body, EchoScene, Material
from handbench.support.compiled import njit

COSINES = 65  # of angles of incidence
BRIGHT = -4.0  # ξ before which the lit side's factor is extrapolated
LIT, DEEP = -1.0, 3.0  # ξ between which p* is fitted; it fades between the first and half of it
TERMS = 6  # of the polynomials in ξ: within 0.006 of m·p*
RADII = np.geomspace(0.8, 4.5, 8)  # m for which they are fitted: radii of 0.6 to 110 mm at 80 GHz
ROUNDEST = float(1 / RADII[0])  # 1/m of the roundest surface with a correction of its own
BENDS = 26  # values of 1/m from 0 to that
# cosine of the angle between faces beyond which an edge is a knife's
SHARP = np.cos(np.radians(30))


class Roundness(NamedTuple):
    """The curvature of a body's surface, and what its creeping waves need.

    normals [n, 3]: unit normals at the vertices; bends_per_m [n, 3, 3]: their derivatives along the
    surface; coefficients [2, m, terms]: polynomials that approximate Pekeris' function p* for
    several radii, for an electric field along an edge and for one across it; dipole [3]: direction
    of the antennas' field; wavenumber: the one for which all this is valid, rad/m.
    """

    normals: np.ndarray
    bends_per_m: np.ndarray
    coefficients: np.ndarray
    dipole: np.ndarray
    wavenumber: float

    def of_edges(
        self, ends: np.ndarray, along_m: np.ndarray, towards: np.ndarray, sharp: np.ndarray
    ) -> np.ndarray:
        """Compute the parameters of the creeping waves around edges: float32 [e, 5 + 2·terms].

        ends [e, 2]: indices of the edges' vertices; along_m [e, 3]: vectors from one end to the
        other; towards [e, 3]: unit directions from the antenna; sharp [e]: True for knife edges. A
        row has the unit normal [3] across the ray; the size m = (ka/2)^{1/3}, or 0 without creeping
        wave, as at a sharp edge; the largest 1/L; and the coefficients, real and then imaginary
        ones, of a polynomial in ξ: the creeping wave divided by e^{−jkδ}/L.
        """
        across = self.normals[ends].sum(axis=1)
        across = unit(across - (across * towards).sum(axis=1)[:, None] * towards)
        bend_per_m = np.einsum("ei,evij,ej->e", towards, self.bends_per_m[ends], towards) / 2
        size = np.cbrt(self.wavenumber / 2 / np.maximum(bend_per_m, 1e-9)).clip(*RADII[[0, -1]])
        size[sharp | (bend_per_m <= 0) | (2 * RADII[0] ** 3 * bend_per_m > self.wavenumber)] = 0
        # counter-clockwise around the body, as seen from the antenna
        edge = np.cross(across, towards)
        field = unit(self.dipole - (towards @ self.dipole)[:, None] * towards)
        share = (field * edge).sum(axis=1)[:, None] ** 2
        place = np.interp(size, RADII, np.arange(len(RADII)))
        below = np.minimum(place.astype(int), len(RADII) - 2)
        part = (place - below)[:, None]
        along, over = (one[below] * (1 - part) + one[below + 1] * part for one in self.coefficients)
        added = (
            -(size * (along_m * edge).sum(axis=1))[:, None]
            / np.sqrt(np.pi)
            * (share * along + (1 - share) * over)
        )
        # kL = 2m²: nearer, points are on the surface
        nearest = self.wavenumber / (2 * np.maximum(size, RADII[0]) ** 2)
        rows = across, size[:, None], nearest[:, None], added.real, added.imag
        return np.concatenate(rows, axis=1).astype(np.float32)


def roundness_of(scene: EchoScene, body: Body) -> Roundness:
    """Return the curvature of a body and the parameters of its creeping waves at the scene's middle
    frequency, computed once per scene. A body of skin is treated as thin skin everywhere."""
    return scene.cached(("roundness", id(body)), lambda: _roundness(scene, body))


def pekeris(xi: np.ndarray, c: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Compute Pekeris' function at the arguments ξ [n], for coefficients c and s [m] that depend on
    polarisation and impedance: complex [n, m], 1/√π ∫ (cV' − sV)/(cW₂' − sW₂) e^{−jξτ} dτ.

    The path of integration comes from infinity along the ray of argument −2π/3 to 0 and goes on
    along the real axis. On the ray, V is replaced by W₁/2j; the difference is the knife edge's
    term.
    """
    nodes, weights = np.polynomial.legendre.leggauss(40)
    # beyond 8 nothing is left
    nodes, weights, turn = (4 * (nodes + 1), 4 * weights[:, None], np.exp(1j * np.pi / 3))
    found = np.zeros((len(xi), len(c)), complex)
    for ray, (ai_part, bi_part), scale in ((1.0, (1.0, 0.0), 1.0), (-turn, (1j, 1.0), turn / 2j)):
        ai, dai, bi, dbi = (one[:, None] for one in airy(ray * nodes))
        above = c * (ai_part * dai + bi_part * dbi) - s * (ai_part * ai + bi_part * bi)
        below = c * (dbi - 1j * dai) - s * (bi - 1j * ai)
        found += np.exp(-1j * ray * np.multiply.outer(xi, nodes)) @ (
            scale * weights * above / below
        )
    return found / np.sqrt(np.pi)


def round_ratios(material: Material, frequency_hz: float) -> np.ndarray:
    """Return the reflection coefficient Γ of a convex surface over that of a plane one at normal
    incidence: complex64 [layers, 2, bends, cosines], for the electric field across the plane of
    incidence and in it.

    The bends 1/m = (2/ka)^{1/3} are evenly spaced from 0, a plane, to ROUNDEST; the cosines and the
    layers are those of `oblique_reflections`.
    """
    cosines = np.maximum(np.linspace(0, 1, COSINES), 1e-6)
    plane = reflections(material, np.array([frequency_hz]), cosines)
    normal = plane[:, 0, -1]
    found = np.repeat(plane[:, :, None], BENDS, axis=2)
    for layer, impedance in zip(found, (1 + normal) / (1 - normal), strict=True):
        for n, bend in enumerate(np.linspace(0, ROUNDEST, BENDS)[1:], 1):
            layer[:, n] += round_differences(impedance, 1 / bend, cosines)
    return np.asarray(found / normal[:, None, None, None], np.complex64)


def round_differences(impedance: complex, size: float, cosines: np.ndarray) -> np.ndarray:
    """Return the reflection coefficient Γ of a cylinder less that of a plane with the same
    impedance: complex [2, n], for a field along the axis and one across it, at cosines [n] of
    incidence. size: m.

    Nearer to grazing incidence than ξ = LIT the difference is that at LIT; before BRIGHT it falls
    with ξ⁻³, as the expansion's next term does.
    """
    away = -2 * size * np.maximum(cosines, 1e-9)
    xi = away.clip(BRIGHT, LIT)
    cosine = xi / (-2 * size)
    ray = np.sqrt(-4 / xi) * np.exp(-1j * (xi**3 / 12 + np.pi / 4))
    found = []
    for sign, c, s, plane in (
        (-1, impedance, -1j * size, (1 - impedance * cosine) / (1 + impedance * cosine)),
        (1, 1.0, -1j * size * impedance, (impedance - cosine) / (impedance + cosine)),
    ):
        crept = pekeris(xi, np.array([c]), np.array([s]))[:, 0]
        lit = ray * (crept - 1 / (2 * np.sqrt(np.pi) * xi))
        found.append(sign * (lit - plane) * np.minimum(BRIGHT / away, 1) ** 3)
    return np.stack(found)


def _roundness(scene: EchoScene, body: Body) -> Roundness:
    frequency_hz = (scene.frequencies_hz.min() + scene.frequencies_hz.max()) / 2
    echo = echo_reflections(body.material, np.array([frequency_hz]))[0, 0]
    impedance = (1 - echo) / (1 + echo)
    xi = np.linspace(LIT, DEEP, 60)
    powers = np.linalg.pinv(xi[:, None] ** np.arange(TERMS))
    along = pekeris(xi, np.full(len(RADII), impedance), -1j * RADII)
    across = pekeris(xi, np.ones(len(RADII)), -1j * RADII * impedance)
    coefficients = np.stack([(powers @ one).T for one in (along, across)])
    normals = vertex_normals(body)
    wavenumber = 2 * np.pi * float(frequency_hz) / SPEED_OF_LIGHT_M_S
    return Roundness(
        normals,
        _bends_per_m(body.vertices_m, body.faces, normals),
        coefficients,
        scene.dipole,
        wavenumber,
    )


@njit(nogil=True, cache=True)
def _bends_per_m(vertices_m, faces, normals):  # type: ignore[no-untyped-def]
    """Compute the derivatives of the unit normals [n, 3] along the surface, at each vertex: [n, 3,
    3] in 1/m. They are means over the faces around the vertex, weighted by area."""
    summed_m, area_m2 = np.zeros((len(vertices_m), 3, 3)), np.full(len(vertices_m), 1e-30)
    for m in range(len(faces)):
        a, b, c = (
            vec(vertices_m[faces[m, 0]]),
            vec(vertices_m[faces[m, 1]]),
            vec(vertices_m[faces[m, 2]]),
        )
        across, doubled_m2 = direction(cross(minus(b, a), minus(c, a)))
        u, v, w = cross(across, minus(c, b)), cross(across, minus(a, c)), cross(across, minus(b, a))
        p, q, r = vec(normals[faces[m, 0]]), vec(normals[faces[m, 1]]), vec(normals[faces[m, 2]])
        for i in faces[m]:
            area_m2[i] += doubled_m2
            for k in range(3):
                for n in range(3):
                    summed_m[i, k, n] += u[k] * p[n] + v[k] * q[n] + w[k] * r[n]
    return summed_m / area_m2.reshape(-1, 1, 1)
