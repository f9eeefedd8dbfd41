"""The effect "multipath": echoes over two places of the target, such as two fingers.

By shooting and bouncing rays (Ling, Chou & Lee, IEEE Trans. Antennas Propag. 37 (1989) 194): the
surface near the first place is divided into plane mirrors, triangles of a quarter wavelength with
the smooth surface's normals at their corners. The ray from a transmitter t to the middle p of a
mirror, of the area A_p across the ray, arrives at q, and the rays through its corners bound a
footprint of the area A_q there. The energy of this tube of rays is conserved, so that the field on
the footprint is √(A_p / (A_q cos θ_qi)) / R_t, θ_qi the angle of incidence. The footprint radiates
by physical optics, whose obliquity is shared evenly between incidence and radiation as in
`radar.simulation.forward`:

    S_f[t, r] = −Σ_tubes √(A_p A_q)/R_t · √cos θ_qr / R_r · F D exp(−j2πf(R_t + |pq| + R_r)/c).

This has no singularity where the tube is focused, A_q = 0. Beyond each focal line the field is a
quarter turn ahead (Balanis, Advanced Engineering Electromagnetics, sec. 13.2); how many there are
follows from the sign and the orientation of the footprint. D = (1 + v/8)⁻⁴, with v the variance of
the phase over the footprint, is the loss by its own pattern, to second order 1 − v/2. F are the
reflections at both places, each with its own angle of incidence: the component of the field across
the plane of incidence keeps its direction and is multiplied by Γ_s, the one in the plane turns with
the ray and is multiplied by Γ_p (Born & Wolf, sec. 1.5.2); at q the observer is where q would
mirror the ray. Either leg is cut off by sharp shadows.

The mean of this and of the same with transmitters and receivers exchanged is reciprocal. Left out
are three places or more, the mirrors' diffraction, and creeping waves.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.distance import cdist

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.imaging.skeleton import band_kernel, skeleton
from handbench.radar.imaging.steering import cis_small, phasor, steered_differences
from handbench.radar.imaging.tree import Box
from handbench.radar.simulation.meshes import face_vectors, quarters, unit, vertex_normals
from handbench.radar.simulation.reflection import echo_reflections, reflections
from handbench.radar.simulation.scene import Body
from handbench.radar.simulation.scene_echoes import Echoes
from handbench.support.compiled import FAST, INNER, njit
from handbench.support.parallel import for_each
from handbench.support.rays import OWN_SURFACE_M

PATCH = 0.25  # longest edge of a mirror, wavelengths,
TRIAL = 0.5  # and of the pieces of the surface that are tried first, from the array's corners
CREASE = 0.85  # cosine between a face and a corner's normal below which the body has an edge there
GROUP_M = 0.03  # edges of the cubes whose mirrors share their antennas
SIGHT_M = 2.5e-3  # of the cubes whose footprints are in sight together
STEEPEST = 1.4  # growth of the path along the footprint (at most 2) above which tubes cancel
PROBES = 150  # places of a group by which its antennas are chosen
TONES = 3e-3  # tolerance of the choice of few tones,
ANTENNAS = 1e-2  # and of few antennas
WIDEST = 100.0  # area of a footprint over that of its mirror, at most: D suppresses wider ones
COSINES = 1025  # of the angle of incidence, for which Γ is tabulated
SUMS = 8  # partial sums, whatever the number of threads


def multipath(echoes: Echoes) -> None:
    """Add the echoes over two places of the target's surface."""
    if echoes.facets is not None:
        echoes.bounced = Bounces(echoes).echo()


class Bounces:
    """The echoes over two places of a target. Triangles are arrays [m, 2, 3, 3]: the corners, and
    the smooth surface's unit normals there."""

    def __init__(self, echoes: Echoes) -> None:
        scene, body = echoes.scene, echoes.scene.body
        self._echoes, self._rays, self._surface = echoes, scene.rays_of(body), triangles_of(body)
        self._flat_m2 = face_vectors(body.vertices_m, body.faces)
        self._layer = echoes.layers
        f, cosines = scene.frequencies_hz, np.maximum(np.linspace(0, 1, COSINES), 1e-6)
        fresnel = reflections(echoes.material, np.array([f.mean()]), cosines)
        self._fresnel = fresnel / fresnel[..., -1:]
        wavenumber = 2 * np.pi * f[:, None] / SPEED_OF_LIGHT_M_S
        extent_m = np.linalg.norm(np.ptp(body.vertices_m, axis=0), axis=0, keepdims=True)
        few, self._tones = skeleton(band_kernel(wavenumber, wavenumber, extent_m), TONES)
        self._few_hz, self._middle_m = f[few], body.vertices_m.mean(axis=0)
        self._turns_per_m = self._few_hz / SPEED_OF_LIGHT_M_S
        once = echo_reflections(echoes.material, self._few_hz).T.astype(np.complex64)
        self._twice = once[:, :, None] * once[:, None]

    def echo(self) -> np.ndarray:
        """Compute the samples [f, t, r], complex64. They are summed at few tones, and for each
        group of mirrors for few antennas, from which all others are interpolated."""
        array, wavelength_m = self._echoes.array, self._echoes.scene.wavelength_m
        antennas_m = np.concatenate([array.tx_m, array.rx_m])
        corners_m = np.unique(Box(antennas_m.min(axis=0), antennas_m.max(axis=0)).corners_m, axis=0)
        pieces, face = split(self._surface, np.arange(len(self._surface)), TRIAL * wavelength_m)
        tried = np.unique(self._mirrored(pieces, face, corners_m)[1])
        mirrors, face = split(pieces[tried], face[tried], PATCH * wavelength_m)
        cubes = _cubes(mirrors[:, 0].mean(axis=1), GROUP_M)
        groups = [np.flatnonzero(cubes == cube) for cube in np.unique(cubes)]
        parts = np.zeros((SUMS, len(self._turns_per_m), *array.channels), np.complex64)

        def work(n: int) -> None:
            for group in groups[n::SUMS]:
                there, back = parts[n], parts[n].swapaxes(1, 2)
                self._add(mirrors[group], face[group], array.tx_m, array.rx_m, there)
                self._add(mirrors[group], face[group], array.rx_m, array.tx_m, back)

        for_each(work, range(SUMS))
        # in order, whatever the threads
        samples = np.tensordot(self._tones.T.astype(np.float32), parts.sum(axis=0) / -2, 1)
        f = self._echoes.scene.frequencies_hz
        to, back = (_paths(leg, self._middle_m) for leg in (array.tx_m, array.rx_m))
        path_m = to[:, None] + back
        return samples * phasor(path_m, f[:, None, None], -1).astype(np.complex64)

    def _mirrored(
        self, mirrors: np.ndarray, face: np.ndarray, tx_m: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Trace the ray from each transmitter [t, 3] over the middle of each mirror, a part of a
        face [m]. Returns for those that meet the body the indices of transmitter, mirror and face,
        the mirror's middle, and the direction after it."""
        middle_m, normal = mirrors[:, 0].mean(axis=1), unit(mirrors[:, 1].sum(axis=1))
        flat = self._flat_m2[face]
        down, tilted = (_dots(middle_m, to) - tx_m @ to.T for to in (flat, normal))
        t, m = np.nonzero((down < 0) & (down > 2 * tilted * _dots(normal, flat)))
        start_m, normal = middle_m[m], normal[m]
        ray = unit(start_m - tx_m[t])
        after = ray - 2 * _dots(ray, normal)[:, None] * normal
        distance, met = self._rays.first_hits(start_m + OWN_SURFACE_M * after, after)
        hit = np.isfinite(distance)
        return t[hit], m[hit], met[hit].astype(int), start_m[hit], after[hit]

    def _add(
        self,
        mirrors: np.ndarray,
        face: np.ndarray,
        tx_m: np.ndarray,
        rx_m: np.ndarray,
        out: np.ndarray,
    ) -> None:
        """Add to samples `out` [k, t, r] at few tones what the rays from the transmitters over a
        group of mirrors, parts of faces [m], radiate to the receivers."""
        at, to_m, to = self._few(mirrors[:, 0].mean(axis=1), tx_m)
        t, m, met, start_m, after = self._mirrored(mirrors, face, tx_m[at])
        shape, field = np.empty((19, len(t)), np.float32), np.empty(len(t), np.complex64)
        layers = self._layer[np.stack([face[m], met])]
        rays = tx_m[at][t], start_m, after, m, met, to_m[t]
        optics = mirrors, self._surface, self._flat_m2, layers, self._fresnel
        land(*rays, *optics, self._echoes.scene.dipole, shape, field)
        lit = np.flatnonzero((field != 0) & self._rays.in_sight(start_m, tx_m[at][t]))
        if not len(lit):
            return
        place_m = shape[1:4, lit].T.astype(float)
        by, back_m, back = self._few(place_m, rx_m)
        _, some, cube = np.unique(_cubes(place_m, SIGHT_M), return_index=True, return_inverse=True)
        ends = np.repeat(place_m[some], len(by), axis=0), np.tile(rx_m[by], (len(some), 1))
        seen = self._rays.in_sight(*ends).reshape(len(some), -1)[cube].T
        weight = field[lit] * self._twice[:, *layers[:, lit]]
        columns = shape[:, lit], weight.real, weight.imag, seen, rx_m[by], back_m, self._turns_per_m
        samples = radiate(
            np.searchsorted(t[lit], np.arange(len(at) + 1)),
            np.float32((2 * np.pi * self._turns_per_m.mean()) ** 2 / 8),
            *(np.ascontiguousarray(column, np.float32) for column in columns),
        )
        out += to.swapaxes(1, 2) @ samples @ back

    def _few(self, points_m: np.ndarray, antennas_m: np.ndarray) -> tuple[np.ndarray, ...]:
        """Choose the few antennas that stand for all for waves to or from points [n, 3] near each
        other: (their indices [m], their paths to the points' mean, complex weights [k, m, a]). The
        weights contain the antennas' pattern, and the phase of the path to the mean without that to
        the body's middle."""
        centre_m, some_m = points_m.mean(axis=0), points_m[:: 1 + len(points_m) // PROBES]
        turns = np.full(len(some_m), self._turns_per_m.max())
        path_m = _paths(antennas_m, centre_m)
        waves = steered_differences(cdist(some_m, antennas_m), path_m, turns)
        at, weights = skeleton(waves.T @ waves / len(some_m), ANTENNAS)
        phases = phasor(path_m - _paths(antennas_m, self._middle_m), self._few_hz[:, None], -1)
        phases *= ((centre_m[2] - antennas_m[:, 2]) / path_m).clip(0) ** self._echoes.pattern
        return at, path_m[at], (weights * phases[:, None]).astype(np.complex64)


def split(
    triangles: np.ndarray, face: np.ndarray, longest_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Split each triangle into four, repeatedly, until its edges are at most longest_m: (the parts,
    `face` [m] of each)."""
    edge_m = np.linalg.norm(triangles[:, 0] - np.roll(triangles[:, 0], 1, axis=1), axis=2)
    times = np.ceil(np.log2(np.maximum(edge_m.max(axis=1) / longest_m, 1)))
    parts, faces, share = [], [], np.eye(3)[None]
    for n in range(int(times.max(initial=0)) + 1):
        part = np.einsum("kcs,mvsi->mkvci", share, triangles[times == n]).reshape(-1, 2, 3, 3)
        part[:, 1] = unit(part[:, 1])
        parts.append(part)
        faces.append(np.repeat(face[times == n], len(share)))
        share = quarters(share)
    return np.concatenate(parts), np.concatenate(faces)


def triangles_of(body: Body) -> np.ndarray:
    """Return all faces of a body with the smooth normals at their corners, or the flat face's
    normal where the body has a sharp edge: [m, 2, 3, 3]."""
    flat = unit(face_vectors(body.vertices_m, body.faces))[:, None]
    smooth = vertex_normals(body)[body.faces]
    normals = np.where(_dots(smooth, flat)[:, :, None] < CREASE, flat, smooth)
    return np.stack([body.vertices_m[body.faces], normals], axis=1)


def _paths(antennas_m: np.ndarray, point_m: np.ndarray) -> np.ndarray:
    return np.linalg.norm(antennas_m - point_m, axis=1)


def _dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", a, b)


def _cubes(points_m: np.ndarray, edge_m: float) -> np.ndarray:
    """Return a number for the cube of space that each point [n, 3] is in."""
    return np.floor(points_m / edge_m).astype(int) @ np.array([1, 1 << 20, 1 << 40])


@njit(**INNER)
def _vec(array):  # type: ignore[no-untyped-def]
    return array[0], array[1], array[2]


@njit(**INNER)
def _minus(a, b):  # type: ignore[no-untyped-def]
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**INNER)
def _ahead(start, length, way):  # type: ignore[no-untyped-def]
    return start[0] + length * way[0], start[1] + length * way[1], start[2] + length * way[2]


@njit(**INNER)
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**INNER)
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**INNER)
def _unit(a):  # type: ignore[no-untyped-def]
    scale = 1 / max(math.sqrt(_dot(a, a)), 1e-30)
    return a[0] * scale, a[1] * scale, a[2] * scale


@njit(**INNER)
def _turned(ray, normal):  # type: ignore[no-untyped-def]
    """Return the direction of a ray after a mirror."""
    return _ahead(ray, -2 * _dot(ray, normal), normal)


@njit(**INNER)
def _area(corners, along):  # type: ignore[no-untyped-def]
    """Return the area of a triangle [3, 3] as seen along a direction, negative from its front."""
    a = _vec(corners[0])
    return _dot(_cross(_minus(_vec(corners[1]), a), _minus(_vec(corners[2]), a)), along) / 2


@njit(**INNER)
def _reflected(field, before, after, gamma):  # type: ignore[no-untyped-def]
    """Return the field of a ray after a mirror: turned as a whole with Γ_p, and Γ_s − Γ_p more of
    its component across the plane of incidence. gamma [2, cosines]: Γ_s and Γ_p over that at normal
    incidence."""
    normal = _unit(_minus(after, before))
    s = _unit(_cross(before, normal))
    cosine = int(_dot(after, normal) * (gamma.shape[1] - 1))
    within = gamma[1, cosine]
    turned = _ahead((0j, 0j, 0j), within, _turned(field, normal))
    return _ahead(turned, (gamma[0, cosine] - within) * _dot(field, s), s)


@njit(**INNER)
def _transverse(dipole, ray):  # type: ignore[no-untyped-def]
    """Return the direction of the field that a short dipole radiates along a ray."""
    return _unit(_ahead(dipole, -_dot(dipole, ray), ray))


@njit(**FAST)
def land(  # type: ignore[no-untyped-def]
    antennas_m,
    starts_m,
    afters,
    mirror,
    face,
    left_out_m,
    mirrors,
    surface,
    flat_m2,
    layers,
    fresnel,
    dipole,
    shape,
    field,
):
    """Follow n tubes to their footprints: write `shape` [19, n] (path R_t + |pq| less one left out;
    q; the surface's unit normal there; for each corner of the footprint the vector from q, and by
    how much its ray is longer) and `field` [n] (√(A_p A_q)/R_t with the angles' part of F, 0 for
    tubes that miss the footprint's plane or cancel).

    antennas_m, starts_m, afters [n, 3]: transmitter, p, and the ray's direction from there; mirror,
    face [n]: the rows of p in `mirrors` and of q in `surface`, both [m, 2, 3, 3]; flat_m2 [m, 3]:
    normals of the surface's faces times their areas; layers [2, n]; fresnel [layers, 2, cosines].
    """
    edges, dipole = np.empty((3, 3)), _vec(dipole)
    for n in range(len(field)):
        antenna, start, after = _vec(antennas_m[n]), _vec(starts_m[n]), _vec(afters[n])
        corners, face_n = mirrors[mirror[n]], surface[face[n]]
        ends, normals, flat = face_n[0], face_n[1], _vec(flat_m2[face[n]])
        way = _minus(start, antenna)
        ray, distance = _unit(way), math.sqrt(_dot(way, way))
        reach = _dot(_minus(_vec(ends[0]), start), flat) / _dot(after, flat)
        end = _ahead(start, reach, after)
        normal = (0.0, 0.0, 0.0)
        for i in range(3):
            b = _minus(_vec(ends[(i + 1) % 3]), end)
            c = _minus(_vec(ends[(i + 2) % 3]), end)
            share = max(_dot(_cross(b, c), flat), 0.0)
            normal = _ahead(normal, share, _vec(normals[i]))
        normal = _unit(normal if _dot(after, normal) < 0 else flat)
        agreement, lit = 0.0, _dot(after, flat) < 0
        for i in range(3):
            corner = _vec(corners[0, i])
            way = _minus(corner, antenna)
            side = _turned(_unit(way), _vec(corners[1, i]))
            falling = _dot(side, normal)
            lit &= falling < 0
            step = _dot(_minus(end, corner), normal) / falling
            edge, off = _minus(_ahead(corner, step, side), end), _minus(corner, start)
            agreement += _dot(off, edge) - _dot(off, after) * _dot(edge, after)
            for axis in range(3):  # arrays from tuples would take seconds to compile
                edges[i, axis] = edge[axis]
                shape[7 + 4 * i + axis, n] = edge[axis]
            shape[10 + 4 * i, n] = math.sqrt(_dot(way, way)) + step - distance - reach
        shape[0, n] = distance + reach - left_out_m[n]
        for axis in range(3):
            shape[1 + axis, n], shape[4 + axis, n] = end[axis], normal[axis]
        growth = _minus(after, _unit(_minus(antenna, end)))
        growth = _ahead(growth, -_dot(growth, normal), normal)
        field[n] = 0
        if lit and _dot(growth, growth) < STEEPEST**2:
            p_m2, q_m2 = -_area(corners[0], ray), _area(edges, normal)
            level = math.sqrt(p_m2 * min(abs(q_m2), WIDEST * p_m2)) / distance
            onward = _turned(after, normal)
            wave = _reflected(_transverse(dipole, ray), ray, after, fresnel[layers[0, n]])
            wave = _reflected(wave, after, onward, fresnel[layers[1, n]])
            focused = 1j if q_m2 > 0 else (-1 + 0j if agreement < 0 else 1 + 0j)
            field[n] = level * focused * _dot(wave, _transverse(dipole, onward))


@njit(**FAST)
def radiate(starts, eighth, shape, re, im, seen, rx_m, back_m, turns_per_m):  # type: ignore[no-untyped-def]
    """Sum what tubes radiate: complex64 [k, t, r], at k tones f/c. The tubes of transmitter t are
    starts[t]:starts[t + 1].

    shape [19, n]: that of `land`; re, im [k, n]: amplitudes; seen [r, n]: 1 where a receiver sees
    q; back_m [r]: path whose phase is left out; eighth: (2πf/c)²/8 at the middle frequency. The
    path over a footprint is quadratic: its mean is that at the middle plus a twelfth of the sum of
    the corners' differences from it.
    """
    samples = np.empty((len(turns_per_m), len(starts) - 1, len(rx_m)), np.complex64)
    gain, path = np.empty_like(shape[0]), np.empty_like(shape[0])
    one, twelfth, zero = np.float32(1), np.float32(1 / 12), np.float32(0)
    for r in range(len(rx_m)):
        for n in range(len(gain)):
            x, y, z = rx_m[r, 0] - shape[1, n], rx_m[r, 1] - shape[2, n], rx_m[r, 2] - shape[3, n]
            away = one / math.sqrt(x * x + y * y + z * z)
            x, y, z = x * away, y * away, z * away
            total, squares = zero, zero
            for i in range(7, 19, 4):
                late = shape[i + 3, n] - x * shape[i, n] - y * shape[i + 1, n] - z * shape[i + 2, n]
                total += late
                squares += late * late
            mean = total * twelfth
            path[n] = shape[0, n] + (one / away - back_m[r]) + mean
            loss = one + eighth * (squares * twelfth - np.float32(4) * mean * mean)
            cosine = max(shape[4, n] * x + shape[5, n] * y + shape[6, n] * z, zero)
            gain[n] = seen[r, n] * math.sqrt(cosine) * away / (loss * loss * loss * loss)
        for t in range(len(starts) - 1):
            of = slice(starts[t], starts[t + 1])
            for k in range(len(turns_per_m)):
                samples[k, t, r] = _sum(re[k, of], im[k, of], gain[of], path[of], -turns_per_m[k])
    return samples


@njit(**INNER)
def _sum(re, im, gain, path, turns):  # type: ignore[no-untyped-def]
    real, imag = np.float32(0), np.float32(0)
    for n in range(len(gain)):
        cosine, sine = cis_small(turns * path[n])
        real += gain[n] * (re[n] * cosine - im[n] * sine)
        imag += gain[n] * (re[n] * sine + im[n] * cosine)
    return complex(real, imag)
