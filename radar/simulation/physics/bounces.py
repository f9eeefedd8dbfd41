"""Kernels of two-bounce echoes: ray tubes that a surface mirrors onto another one, which radiates by physical optics.

A tube from transmitter t is mirrored by a patch at p, of the area A_p across the ray, and lands at q on a footprint of
the area A_q in the surface. Its energy keeps, so that the field on the footprint is √(A_p / (A_q cos θ_qi)) / R_t, θ_qi
the angle of incidence; with physical optics' integrand, shared evenly by both legs as in `radar.simulation.forward`,

    S_f[t, r] = Σ_tubes √(A_p A_q) / R_t · √cos θ_qr / R_r · D · exp(−j2πf(R_t + |pq| + R_r)/c),

which has no singularity at caustics, where A_q vanishes (the field's quarter turn beyond them is left out). D is what
the phase, which is not the same all over a footprint, leaves of it: see `radiate`. Shooting and bouncing rays: Ling,
Chou & Lee, IEEE Trans. Antennas Propag. 37 (1989) 194.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from radar.imaging.cpu.steering import FAST, cis_small

WIDEST = 100.0  # footprint over patch, at most: what is wider leaves a caustic or grazes, and D silences it
STEEPEST = 1.4  # rise of the path along the surface (at most 2) beyond which a tube counts nothing


class Tubes(NamedTuple):
    """n tubes: transmitter, patch (mirror) and face (where it lands) [n]; start_m [n, 3] p; end_m [n, 3] q; normal
    [n, 3] of the surface at q; length_m [n] |pq|; root_m2 [n] √(A_p A_q), 0 for what is no tube; edge_m [n, 3, 3]: from
    q to the footprint's corners; longer_m [n, 3]: by how much their rays are longer than the middle's."""

    transmitter: np.ndarray
    patch: np.ndarray
    face: np.ndarray
    start_m: np.ndarray
    end_m: np.ndarray
    normal: np.ndarray
    length_m: np.ndarray
    root_m2: np.ndarray
    edge_m: np.ndarray
    longer_m: np.ndarray


class Patches(NamedTuple):
    """m mirrors: corners_m and unit normals at them [m, 3, 3]; middle_m [m, 3] and the unit normal there, normal [m,
    3]; flat_m2 [m, 3], the face's normal times its area."""

    corners_m: np.ndarray
    normals: np.ndarray
    middle_m: np.ndarray
    normal: np.ndarray
    flat_m2: np.ndarray


@numba.njit(**FAST)
def mirror(patches, antenna_m, chosen, direction):  # type: ignore[no-untyped-def]
    """Fill in the direction [n, 3] in which the middle of each chosen patch [n] mirrors an antenna [3]; whether the
    patch turns its front to both, bool [n]."""
    front = np.empty(len(chosen), np.bool_)
    antenna = _vector(antenna_m)
    for n in range(len(chosen)):
        flat = _vector(patches.flat_m2[chosen[n]])
        incoming, _ = _unit(_minus(_vector(patches.middle_m[chosen[n]]), antenna))
        bounced = _mirrored(incoming, _vector(patches.normal[chosen[n]]))
        direction[n, 0], direction[n, 1], direction[n, 2] = bounced
        front[n] = _dot(incoming, flat) < 0 and _dot(bounced, flat) > 0
    return front


@numba.njit(**FAST)
def land(tubes, patches, tx_m, surface):  # type: ignore[no-untyped-def]
    """Fill in tubes from their transmitter, patch and face of the surface (the whole body as patches). What lands on a
    back, or with a corner's ray that misses the surface's plane, gets root_m2 = 0, and so does what lands so far from
    the direction in which it would be mirrored towards the transmitter that the neighbours' echoes cancel its own."""
    for n in range(len(tubes.face)):
        patch, face = tubes.patch[n], tubes.face[n]
        antenna, start = _vector(tx_m[tubes.transmitter[n]]), _vector(patches.middle_m[patch])
        flat = _vector(surface.flat_m2[face])
        incoming, distance = _unit(_minus(start, antenna))
        bounced = _mirrored(incoming, _vector(patches.normal[patch]))
        for axis in range(3):
            tubes.start_m[n, axis], tubes.end_m[n, axis] = start[axis], start[axis]
        tubes.length_m[n] = tubes.root_m2[n] = 0.0
        towards = _dot(bounced, flat)
        if towards >= 0:
            continue
        length = _dot(_minus(_vector(surface.corners_m[face, 0]), start), flat) / towards
        end = _along(start, length, bounced)
        normal = _interpolated(end, surface.corners_m[face], surface.normals[face], flat)
        if _dot(bounced, normal) >= 0:
            normal, _ = _unit(flat)
        rise = _minus(bounced, _unit(_minus(antenna, end))[0])  # of the path per metre along the surface
        missed = _length(_along(rise, -_dot(rise, normal), normal)) > STEEPEST
        for i in range(3):
            corner = _vector(patches.corners_m[patch, i])
            ray, way = _unit(_minus(corner, antenna))
            ray = _mirrored(ray, _vector(patches.normals[patch, i]))
            falling = _dot(ray, normal)
            reach = _dot(_minus(end, corner), normal) / falling if falling < 0 else 0.0
            missed |= falling >= 0
            edge = _minus(_along(corner, reach, ray), end)
            tubes.edge_m[n, i, 0], tubes.edge_m[n, i, 1], tubes.edge_m[n, i, 2] = edge
            tubes.longer_m[n, i] = way + reach - distance - length
        tubes.length_m[n] = length
        for axis in range(3):
            tubes.end_m[n, axis], tubes.normal[n, axis] = end[axis], normal[axis]
        if not missed:
            edges = tubes.edge_m[n]
            origin = _vector(edges[0])
            twice = _length(_cross(_minus(_vector(edges[1]), origin), _minus(_vector(edges[2]), origin)))
            patch_m2 = -_dot(_vector(patches.flat_m2[patch]), incoming)
            tubes.root_m2[n] = np.sqrt(patch_m2 * min(twice / 2, WIDEST * patch_m2))


@numba.njit(inline="always")
def _interpolated(point, corners, normals, flat):  # type: ignore[no-untyped-def]
    """The unit normal at a point of a triangle (corners [3, 3]) between those at its corners [3, 3]."""
    a, b, c = _minus(_vector(corners[0]), point), _minus(_vector(corners[1]), point), _minus(_vector(corners[2]), point)
    u, v, w = max(_dot(_cross(b, c), flat), 0.0), max(_dot(_cross(c, a), flat), 0.0), max(_dot(_cross(a, b), flat), 0.0)
    mixed = _along((0.0, 0.0, 0.0), u, _vector(normals[0]))
    mixed = _along(mixed, v, _vector(normals[1]))
    return _unit(_along(mixed, w, _vector(normals[2])))[0]


@numba.njit(inline="always")
def _vector(array):  # type: ignore[no-untyped-def]
    return array[0], array[1], array[2]  # tuples stay in registers


@numba.njit(inline="always")
def _minus(a, b):  # type: ignore[no-untyped-def]
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@numba.njit(inline="always")
def _along(start, length, direction):  # type: ignore[no-untyped-def]
    return start[0] + length * direction[0], start[1] + length * direction[1], start[2] + length * direction[2]


@numba.njit(inline="always")
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(inline="always")
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(inline="always")
def _length(a):  # type: ignore[no-untyped-def]
    return np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@numba.njit(inline="always")
def _unit(a):  # type: ignore[no-untyped-def]
    """The unit vector, and the length."""
    length = _length(a)
    scale = 1 / max(length, 1e-30)
    return (a[0] * scale, a[1] * scale, a[2] * scale), length


@numba.njit(inline="always")
def _mirrored(incoming, normal):  # type: ignore[no-untyped-def]
    return _along(incoming, -2 * _dot(incoming, normal), normal)


@numba.njit(**FAST)
def radiate(  # type: ignore[no-untyped-def]
    tubes, factor, starts, tx_m, rx_m, before_m, after_m, turns_per_m, middle, pattern, seen
):
    """Samples [k, 2, t, r] of tubes sorted by transmitter (t has starts[t]:starts[t + 1]), without the phase of the
    paths before_m [t] + after_m [r]. factor complex64 [n]: of each tube's amplitude. seen [faces, r] float32: 1 where
    receiver r sees the face.

    D = (1 + v/8)⁻⁴, v the variance of the phase over the footprint, taken as linear between its corners, at the middle
    frequency (in turns per metre): the footprint's own pattern to second order (1 − v/2), which fades where it would
    need a finer mesh. The path is the mean over the footprint, were it quadratic: a twelfth of the sum of the corners'
    above the middle's.
    """
    samples = np.zeros((len(turns_per_m), 2, len(tx_m), len(rx_m)), np.float32)
    gain, path = np.empty(len(rx_m), np.float32), np.empty(len(rx_m), np.float32)
    square = (2 * np.pi * middle) ** 2
    for t in range(len(tx_m)):
        for n in range(starts[t], starts[t + 1]):
            if tubes.root_m2[n] == 0:
                continue
            way = _minus(_vector(tubes.start_m[n]), _vector(tx_m[t]))
            distance = _length(way)
            amplitude = tubes.root_m2[n] / distance
            if pattern != 0:
                amplitude *= max(way[2] / distance, 0.0) ** pattern
            base = distance + tubes.length_m[n] - before_m[t]
            end, normal, edge, longer = tubes.end_m[n], tubes.normal[n], tubes.edge_m[n], tubes.longer_m[n]
            sight, real, imag = seen[tubes.face[n]], factor[n].real, factor[n].imag
            for r in range(len(rx_m)):
                ux, uy, uz = rx_m[r, 0] - end[0], rx_m[r, 1] - end[1], rx_m[r, 2] - end[2]
                length = np.sqrt(ux * ux + uy * uy + uz * uz)
                scale = 1 / length
                ux, uy, uz = ux * scale, uy * scale, uz * scale
                a = longer[0] - ux * edge[0, 0] - uy * edge[0, 1] - uz * edge[0, 2]
                b = longer[1] - ux * edge[1, 0] - uy * edge[1, 1] - uz * edge[1, 2]
                c = longer[2] - ux * edge[2, 0] - uy * edge[2, 1] - uz * edge[2, 2]
                whole = a + b + c
                path[r] = base + length - after_m[r] + whole / 12
                variance = square * ((a * a + b * b + c * c) / 12 - whole * whole / 36)
                fade = 1 / (1 + variance / 8)
                fade *= fade
                cosine = max(normal[0] * ux + normal[1] * uy + normal[2] * uz, 0.0)
                gain[r] = amplitude * scale * np.sqrt(cosine) * fade * fade * sight[r]
                if pattern != 0:
                    gain[r] *= max(-uz, 0.0) ** pattern
            for m in range(len(turns_per_m)):
                turns = np.float32(-turns_per_m[m])
                for r in range(len(rx_m)):
                    cosine, sine = cis_small(turns * path[r])
                    samples[m, 0, t, r] += gain[r] * (real * cosine - imag * sine)
                    samples[m, 1, t, r] += gain[r] * (real * sine + imag * cosine)
    return samples
