"""Kernels of two-bounce echoes: ray tubes that a surface mirrors onto another one, which radiates by physical optics.

A tube from transmitter t is mirrored by a patch at p, of the area A_p across the ray, and lands at q on a footprint of
the area A_q in the surface. Its energy keeps, so that the field on the footprint is √(A_p / (A_q cos θ_qi)) / R_t, θ_qi
the angle of incidence; with physical optics' integrand, shared evenly by both legs as in `radar.simulation.forward`,

    S_f[t, r] = Σ_tubes √(A_p A_q) / R_t · √cos θ_qr / R_r · D · exp(−j2πf(R_t + |pq| + R_r)/c),

which has no singularity at caustics, where A_q vanishes; beyond each, the field is a quarter turn ahead (Balanis,
Advanced Engineering Electromagnetics, sec. 13.2). D is what the phase, which is not the same all over a footprint,
leaves of it: see `radiate`. Shooting and bouncing rays: Ling, Chou & Lee, IEEE Trans. Antennas Propag. 37 (1989) 194.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from radar.imaging.cpu.steering import FAST, cis_small
from radar.simulation.physics.vectors import ahead, cross, direction, dot, minus, mirrored, norm, vec

WIDEST = 100.0  # footprint over patch, at most: what is wider leaves a caustic or grazes, and D silences it
FAINT = 0.02  # of a footprint's phases left over, for the receiver that sees most of it: counts nothing
STEEPEST = 1.4  # rise of the path along the surface (at most 2) beyond which a tube counts nothing


class Tubes(NamedTuple):
    """n tubes: transmitter, patch (mirror) and face (where it lands) [n]; start_m [n, 3] p; end_m [n, 3] q; normal
    [n, 3] of the surface at q; length_m [n] |pq|; root_m2 [n] √(A_p A_q), 0 for what is no tube; edge_m [n, 3, 3]: from
    q to the footprint's corners; longer_m [n, 3]: by how much their rays are longer than the middle's; caustics [n]:
    how many lie on |pq|, 0 to 2."""

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
    caustics: np.ndarray


class Patches(NamedTuple):
    """m mirrors: corners_m and unit normals at them [m, 3, 3]; middle_m [m, 3] and the unit normal there, normal [m,
    3]; flat_m2 [m, 3], the face's normal times its area."""

    corners_m: np.ndarray
    normals: np.ndarray
    middle_m: np.ndarray
    normal: np.ndarray
    flat_m2: np.ndarray


@numba.njit(**FAST)
def mirror(patches, antenna_m, chosen, onward):  # type: ignore[no-untyped-def]
    """Fill in the directions onward [n, 3] in which the middle of each chosen patch [n] mirrors an antenna [3]; whether
    the patch turns its front to both, bool [n]."""
    front = np.empty(len(chosen), np.bool_)
    antenna = vec(antenna_m)
    for n in range(len(chosen)):
        flat = vec(patches.flat_m2[chosen[n]])
        incoming, _ = direction(minus(vec(patches.middle_m[chosen[n]]), antenna))
        bounced = mirrored(incoming, vec(patches.normal[chosen[n]]))
        onward[n, 0], onward[n, 1], onward[n, 2] = bounced
        front[n] = dot(incoming, flat) < 0 and dot(bounced, flat) > 0
    return front


@numba.njit(**FAST)
def land(tubes, patches, tx_m, surface):  # type: ignore[no-untyped-def]
    """Fill in tubes from their transmitter, patch and face of the surface (the whole body as patches). What lands on a
    back, or with a corner's ray that misses the surface's plane, gets root_m2 = 0, and so does what lands so far from
    the direction in which it would be mirrored towards the transmitter that the neighbours' echoes cancel its own."""
    for n in range(len(tubes.face)):
        patch, face = tubes.patch[n], tubes.face[n]
        antenna, start = vec(tx_m[tubes.transmitter[n]]), vec(patches.middle_m[patch])
        flat = vec(surface.flat_m2[face])
        incoming, distance = direction(minus(start, antenna))
        bounced = mirrored(incoming, vec(patches.normal[patch]))
        for axis in range(3):
            tubes.start_m[n, axis], tubes.end_m[n, axis] = start[axis], start[axis]
        tubes.length_m[n] = tubes.root_m2[n] = 0.0
        towards = dot(bounced, flat)
        if towards >= 0:
            continue
        length = dot(minus(vec(surface.corners_m[face, 0]), start), flat) / towards
        end = ahead(start, length, bounced)
        normal = _interpolated(end, surface.corners_m[face], surface.normals[face], flat)
        if dot(bounced, normal) >= 0:
            normal, _ = direction(flat)
        rise = minus(bounced, direction(minus(antenna, end))[0])  # of the path per metre along the surface
        missed = norm(ahead(rise, -dot(rise, normal), normal)) > STEEPEST
        for i in range(3):
            corner = vec(patches.corners_m[patch, i])
            ray, way = direction(minus(corner, antenna))
            ray = mirrored(ray, vec(patches.normals[patch, i]))
            falling = dot(ray, normal)
            reach = dot(minus(end, corner), normal) / falling if falling < 0 else 0.0
            missed |= falling >= 0
            edge = minus(ahead(corner, reach, ray), end)
            tubes.edge_m[n, i, 0], tubes.edge_m[n, i, 1], tubes.edge_m[n, i, 2] = edge
            tubes.longer_m[n, i] = way + reach - distance - length
        tubes.length_m[n] = length
        for axis in range(3):
            tubes.end_m[n, axis], tubes.normal[n, axis] = end[axis], normal[axis]
        if not missed:
            patch_m2 = -dot(vec(patches.flat_m2[patch]), incoming)
            twice_m2, alike = _mapped(patches.corners_m[patch], tubes.edge_m[n], start, bounced, normal)
            tubes.root_m2[n] = np.sqrt(patch_m2 * min(abs(twice_m2) / 2, WIDEST * patch_m2))
            tubes.caustics[n] = 1 if twice_m2 < 0 else (2 if alike < 0 else 0)


@numba.njit(inline="always")
def _mapped(corners, edges, start, bounced, normal):  # type: ignore[no-untyped-def]
    """Twice a footprint's area, negative where the tube is turned over, as beyond one caustic; and the scalar product
    of the patch's and the footprint's shapes across the ray, negative where it is upside down, as beyond two."""
    alike = 0.0
    for i in range(3):
        corner = minus(vec(corners[i]), start)
        alike += dot(ahead(corner, -dot(corner, bounced), bounced), vec(edges[i]))
    origin = vec(edges[0])
    area = cross(minus(vec(edges[2]), origin), minus(vec(edges[1]), origin))
    return dot(area, normal), alike


@numba.njit(inline="always")
def _interpolated(point, corners, normals, flat):  # type: ignore[no-untyped-def]
    """The unit normal at a point of a triangle (corners [3, 3]) between those at its corners [3, 3]."""
    a, b, c = minus(vec(corners[0]), point), minus(vec(corners[1]), point), minus(vec(corners[2]), point)
    u, v, w = max(dot(cross(b, c), flat), 0.0), max(dot(cross(c, a), flat), 0.0), max(dot(cross(a, b), flat), 0.0)
    mixed = ahead((0.0, 0.0, 0.0), u, vec(normals[0]))
    mixed = ahead(mixed, v, vec(normals[1]))
    return direction(ahead(mixed, w, vec(normals[2])))[0]


@numba.njit(**FAST)
def radiate(  # type: ignore[no-untyped-def]
    tubes, factor, pair, reflection, starts, tx_m, rx_m, before_m, after_m, turns_per_m, middle, pattern, seen
):
    """Samples [k, 2, t, r] of tubes sorted by transmitter (t has starts[t]:starts[t + 1]), without the phase of the
    paths before_m [t] + after_m [r]. factor complex64 [n]: of each tube's amplitude, with the row pair[n] of
    reflection, complex64 [pairs, k]. seen [faces, r] float32: 1 where receiver r sees the face.

    D = (1 + v/8)⁻⁴, v the variance of the phase over the footprint, taken as linear between its corners, at the middle
    frequency (in turns per metre): the footprint's own pattern to second order (1 − v/2), which fades where it would
    need a finer mesh. The path is the mean over the footprint, were it quadratic: a twelfth of the sum of the corners'
    above the middle's.
    """
    samples = np.zeros((len(turns_per_m), 2, len(tx_m), len(rx_m)), np.float32)
    gain, path = np.empty(len(rx_m), np.float32), np.empty(len(rx_m), np.float32)
    x_m, y_m, z_m = rx_m[:, 0].astype(np.float32), rx_m[:, 1].astype(np.float32), rx_m[:, 2].astype(np.float32)
    behind_m, zero, one, twelfth = after_m.astype(np.float32), np.float32(0), np.float32(1), np.float32(1 / 12)
    eighth = np.float32((2 * np.pi * middle) ** 2 / 8)
    for t in range(len(tx_m)):
        for n in range(starts[t], starts[t + 1]):
            if tubes.root_m2[n] == 0:
                continue
            way = minus(vec(tubes.start_m[n]), vec(tx_m[t]))
            distance = norm(way)
            amplitude = tubes.root_m2[n] / distance
            if pattern != 0:
                amplitude *= max(way[2] / distance, 0.0) ** pattern
            level, base = np.float32(amplitude), np.float32(distance + tubes.length_m[n] - before_m[t])
            x, y, z = _single(tubes.end_m[n])
            nx, ny, nz = _single(tubes.normal[n])
            ax, ay, az = _single(tubes.edge_m[n, 0])
            bx, by, bz = _single(tubes.edge_m[n, 1])
            cx, cy, cz = _single(tubes.edge_m[n, 2])
            longer_a, longer_b, longer_c = _single(tubes.longer_m[n])
            sight, clearest = seen[tubes.face[n]], zero
            for r in range(len(rx_m)):
                ux, uy, uz = x_m[r] - x, y_m[r] - y, z_m[r] - z
                length = np.sqrt(ux * ux + uy * uy + uz * uz)
                scale = one / length
                ux, uy, uz = ux * scale, uy * scale, uz * scale
                a = longer_a - ux * ax - uy * ay - uz * az
                b = longer_b - ux * bx - uy * by - uz * bz
                c = longer_c - ux * cx - uy * cy - uz * cz
                mean = (a + b + c) * twelfth
                path[r] = base + (length - behind_m[r]) + mean
                fade = one / (one + eighth * ((a * a + b * b + c * c) * twelfth - np.float32(4) * mean * mean))
                fade *= fade
                cosine = max(nx * ux + ny * uy + nz * uz, zero)
                gain[r] = level * scale * np.sqrt(cosine) * fade * fade * sight[r]
                if pattern != 0:
                    gain[r] *= max(-uz, zero) ** pattern
                clearest = max(clearest, fade * sight[r])
            if clearest * clearest < FAINT:
                continue
            for m in range(len(turns_per_m)):
                turns, weight = np.float32(-turns_per_m[m]), factor[n] * reflection[pair[n], m]
                real, imag = weight.real, weight.imag
                for r in range(len(rx_m)):
                    cosine, sine = cis_small(turns * path[r])
                    samples[m, 0, t, r] += gain[r] * (real * cosine - imag * sine)
                    samples[m, 1, t, r] += gain[r] * (real * sine + imag * cosine)
    return samples


@numba.njit(inline="always")
def _single(array):  # type: ignore[no-untyped-def]
    return np.float32(array[0]), np.float32(array[1]), np.float32(array[2])
