"""Compiled code for echoes with several bounces, by shooting and bouncing rays: one part of the
surface reflects a ray tube onto another part, which radiates by physical optics.

A tube from transmitter t is mirrored by a patch at p, of the area A_p across the ray, and arrives
at q on a footprint of the area A_q in the surface. Its energy is conserved, so that the field on
the footprint is √(A_p / (A_q cos θ_qi)) / R_t, θ_qi the angle of incidence. With the integrand of
physical optics, whose obliquity is shared evenly between incidence and radiation as in
`radar.simulation.forward`,

    S_f[t, r] = Σ_tubes √(A_p A_q) / R_t · √cos θ_qr / R_r · D · exp(−j2πf(R_t + |pq| + R_r)/c),

which has no singularity at caustics, where A_q vanishes; beyond each, the field is a quarter turn
ahead (Balanis, Advanced Engineering Electromagnetics, sec. 13.2). The factor D ≤ 1 is the loss
because the phase varies over the footprint (`radiate`). Shooting and bouncing rays: Ling, Chou &
Lee, IEEE Trans. Antennas Propag. 37 (1989) 194.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handbench.radar.imaging.cpu.steering import cis_small
from handbench.radar.simulation.physics.creeping import RADII
from handbench.radar.simulation.physics.vectors import (
    ahead,
    cross,
    direction,
    dot,
    minus,
    mirrored,
    norm,
    vec,
)
from handbench.support.compiled import FAST, INNER, njit

LEAST, MOST = float(RADII[0]), float(RADII[-1])  # m of the edges around which waves creep
# largest footprint relative to its patch: wider tubes leave a caustic or graze, and D suppresses
# them
WIDEST = 100.0
# a tube whose D is smaller at all receivers is left out
FAINT = 0.02
BEYOND = 8.0  # widths of a face over which its normals are extrapolated
STEEPEST = 1.4  # growth of the path along the surface (at most 2) above which a tube is left out


class Tubes(NamedTuple):
    """n ray tubes, each of which meets the body b + 1 times. The rays of a tube go from a
    transmitter to a patch (a triangle that acts as a mirror, with the middle p), are reflected from
    face to face, and cover a footprint (with the middle q) on the last face, which radiates.

    transmitter, patch: indices [n]; faces [n, b]: faces of the body after the patch, in the order
    met; points_m [n, b + 1, 3]: the path's corners from p to q; normal [n, 3]: that of the surface
    at q; length_m [n]: path from p to q. root_m2 [n]: √(A_p A_q) of the areas of patch and
    footprint, 0 for an invalid tube; edge_m [n, 3, 3]: vectors from q to the footprint's corners;
    longer_m [n, 3]: by how much the rays to these corners are longer than that to q; caustics [n]:
    number of focal lines between p and q, 0 to 2 between successive corners of the path; bend_per_m
    [n, b + 1]: curvature of the surface along the path at each place, positive if convex.
    """

    transmitter: np.ndarray
    patch: np.ndarray
    faces: np.ndarray
    points_m: np.ndarray
    normal: np.ndarray
    length_m: np.ndarray
    root_m2: np.ndarray
    edge_m: np.ndarray
    longer_m: np.ndarray
    caustics: np.ndarray
    bend_per_m: np.ndarray


class Patches(NamedTuple):
    """m triangles that act as mirrors.

    corners_m [m, 3, 3]: corners; normals [m, 3, 3]: unit normals of the smooth surface at the
    corners; middle_m [m, 3]: middles; normal [m, 3]: unit normals of the smooth surface there;
    flat_m2 [m, 3]: normal of the flat triangle times its area.
    """

    corners_m: np.ndarray
    normals: np.ndarray
    middle_m: np.ndarray
    normal: np.ndarray
    flat_m2: np.ndarray


@njit(**FAST)
def mirror(patches, antenna_m, chosen, ahead_m, ways):  # type: ignore[no-untyped-def]
    """Reflect the rays from an antenna [3] at the middles of the patches with indices `chosen` [n].
    Returns a boolean mask [n], True for patches that face both the antenna and the reflected ray.

    The reflected rays of these patches are written to the first rows of `ways` [n, 6]: origin, then
    unit direction. The origin is moved along the ray by the length ahead_m, so that the ray does
    not meet its own patch.
    """
    front, count = np.empty(len(chosen), np.bool_), 0
    antenna = vec(antenna_m)
    for n in range(len(chosen)):
        flat, middle = vec(patches.flat_m2[chosen[n]]), vec(patches.middle_m[chosen[n]])
        incoming, _ = direction(minus(middle, antenna))
        bounced = mirrored(incoming, vec(patches.normal[chosen[n]]))
        front[n] = dot(incoming, flat) < 0 and dot(bounced, flat) > 0
        if front[n]:
            ways[count, 0], ways[count, 1], ways[count, 2] = ahead(middle, ahead_m, bounced)
            ways[count, 3], ways[count, 4], ways[count, 5] = bounced
            count += 1
    return front


@njit(**FAST)
def land(tubes, patches, tx_m, surface, wavenumber, lit):  # type: ignore[no-untyped-def]
    """Follow ray tubes to their ends, and fill in all fields of `tubes` that follow from
    transmitter, patch and faces. surface: all faces of the body as patches.

    root_m2 stays 0, which marks an invalid tube, for tubes that meet the back of a face, whose
    corner rays miss the plane of the footprint, or that are so far from specular that neighbouring
    tubes cancel them. With a wavenumber above 0, fields are reduced by the share that creeping
    waves carry (`radar.simulation.physics.creeping`), which fade towards the argument `lit` < 0 of
    Pekeris' function.
    """
    corners, rays, late = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    bounces = tubes.faces.shape[1]
    for n in range(len(tubes.faces)):
        patch, antenna = tubes.patch[n], vec(tx_m[tubes.transmitter[n]])
        point = vec(patches.middle_m[patch])
        incoming, distance = direction(minus(point, antenna))
        ray, normal = mirrored(incoming, vec(patches.normal[patch])), vec(patches.normal[patch])
        for i in range(3):
            way, far = direction(minus(vec(patches.corners_m[patch, i]), antenna))
            late[i] = far - distance
            corners[i, 0], corners[i, 1], corners[i, 2] = vec(patches.corners_m[patch, i])
            rays[i, 0], rays[i, 1], rays[i, 2] = mirrored(way, vec(patches.normals[patch, i]))
        for axis in range(3):
            tubes.points_m[n, :, axis] = point[axis]
        tubes.bend_per_m[n, 0] = _bend_per_m(patches, patch, incoming)
        tubes.length_m[n] = tubes.root_m2[n] = 0.0
        crossed, twice_m2, missed = 0, 1.0, False
        for b in range(bounces):
            face = tubes.faces[n, b]
            if b > 0:
                missed |= not _turn(corners, rays, surface, tubes.faces[n, b - 1])
                ray = mirrored(ray, normal)
            flat = vec(surface.flat_m2[face])
            towards = dot(ray, flat)
            tubes.bend_per_m[n, b + 1] = _bend_per_m(surface, face, ray)
            if missed or towards >= 0:
                missed = True
                break
            reach = dot(minus(vec(surface.corners_m[face, 0]), point), flat) / towards
            end = ahead(point, reach, ray)
            normal = _interpolated(end, surface.corners_m[face], surface.normals[face], flat, 0.0)
            if dot(ray, normal) >= 0:
                normal, _ = direction(flat)
            agreement = 0.0
            for i in range(3):
                before, way = vec(corners[i]), vec(rays[i])
                falling = dot(way, normal)
                missed |= falling >= 0
                step = dot(minus(end, before), normal) / falling if falling < 0 else 0.0
                edge, off = minus(ahead(before, step, way), end), minus(before, point)
                agreement += dot(ahead(off, -dot(off, ray), ray), edge)
                late[i] += step - reach
                corners[i, 0], corners[i, 1], corners[i, 2] = ahead(end, 1.0, edge)
                tubes.edge_m[n, i, 0], tubes.edge_m[n, i, 1], tubes.edge_m[n, i, 2] = edge
            was_m2, twice_m2 = twice_m2, _twice_m2(tubes.edge_m[n], normal)
            crossed += 1 if (twice_m2 > 0) == (was_m2 > 0) else (2 if agreement < 0 else 0)
            tubes.length_m[n] += reach
            point = end
            for axis in range(3):
                tubes.points_m[n, b + 1, axis], tubes.normal[n, axis] = point[axis], normal[axis]
        for i in range(3):
            tubes.longer_m[n, i] = late[i]
        # of the path per metre along the surface
        rise = minus(ray, direction(minus(antenna, point))[0])
        if missed or norm(ahead(rise, -dot(rise, normal), normal)) > STEEPEST:
            continue
        patch_m2 = -dot(vec(patches.flat_m2[patch]), incoming)
        tubes.root_m2[n] = np.sqrt(patch_m2 * min(abs(twice_m2) / 2, WIDEST * patch_m2))
        if wavenumber > 0:
            sine = -dot(incoming, vec(patches.normal[patch]))
            tubes.root_m2[n] *= _mirrored_share(tubes.bend_per_m[n, 0], sine, wavenumber, lit)
        tubes.caustics[n] = crossed


@njit(**INNER)
def _bend_per_m(patches, patch, incoming):  # type: ignore[no-untyped-def]
    """Return the curvature of the smooth surface in a patch along an incoming ray, in 1/m, positive
    if convex."""
    flat, normal = vec(patches.flat_m2[patch]), vec(patches.normal[patch])
    along = direction(ahead(incoming, -dot(incoming, normal), normal))[0]
    step_m = np.sqrt(norm(flat))
    there = _interpolated(
        ahead(vec(patches.middle_m[patch]), step_m, along),
        patches.corners_m[patch],
        patches.normals[patch],
        flat,
        -BEYOND,
    )
    return dot(minus(there, normal), along) / step_m


@njit(**INNER)
def _mirrored_share(bend_per_m, sine, wavenumber, lit):  # type: ignore[no-untyped-def]
    """Return the share, 0 to 1, of the incident field that a surface reflects as a ray. On a convex
    one near grazing incidence it is less than 1, since creeping waves carry the rest. sine: that of
    the angle between ray and surface."""
    if bend_per_m <= 1e-9 or 2 * LEAST**3 * bend_per_m > wavenumber:
        return 1.0
    size = min(np.cbrt(wavenumber / 2 / bend_per_m), MOST)
    ahead_of = min(max(-4 * size * np.arcsin(min(sine, 1.0)) / lit - 1, 0.0), 1.0)
    return ahead_of * ahead_of * (3 - 2 * ahead_of)


@njit(**INNER)
def _turn(corners, rays, surface, face):  # type: ignore[no-untyped-def]
    """Reflect the rays through the corners of a footprint at the normals of the smooth surface
    there, extrapolated beyond the face. The reflected directions are written to `rays`. Returns
    True if all rays meet the front of the surface."""
    front = True
    for i in range(3):
        flat = vec(surface.flat_m2[face])
        normal = _interpolated(
            vec(corners[i]), surface.corners_m[face], surface.normals[face], flat, -BEYOND
        )
        front &= dot(vec(rays[i]), normal) < 0
        rays[i, 0], rays[i, 1], rays[i, 2] = mirrored(vec(rays[i]), normal)
    return front


@njit(inline="always")
def _twice_m2(edges, normal):  # type: ignore[no-untyped-def]
    """Return twice the area of a footprint with the corners `edges` [3, 3]. It is negative if
    reflection has reversed the order of the corners, which is counter-clockwise on the patch."""
    origin = vec(edges[0])
    return dot(cross(minus(vec(edges[1]), origin), minus(vec(edges[2]), origin)), normal)


@njit(**INNER)
def _interpolated(point, corners, normals, flat, least):  # type: ignore[no-untyped-def]
    """Return the unit normal [3] at a point in the plane of a triangle, interpolated between the
    normals at its corners (both [3, 3]). Outside the triangle it is extrapolated, with barycentric
    coordinates not below `least`."""
    a, b, c = (
        minus(vec(corners[0]), point),
        minus(vec(corners[1]), point),
        minus(vec(corners[2]), point),
    )
    square = least * dot(flat, flat) * 2
    u, v, w = (
        max(dot(cross(b, c), flat), square),
        max(dot(cross(c, a), flat), square),
        max(dot(cross(a, b), flat), square),
    )
    mixed = ahead((0.0, 0.0, 0.0), u, vec(normals[0]))
    mixed = ahead(mixed, v, vec(normals[1]))
    return direction(ahead(mixed, w, vec(normals[2])))[0]


@njit(**FAST)
def radiate(  # type: ignore[no-untyped-def]
    tubes,
    factor,
    pair,
    reflection,
    starts,
    tx_m,
    rx_m,
    before_m,
    after_m,
    turns_per_m,
    middle,
    pattern,
    seen,
):
    """Compute the samples that ray tubes radiate to the receivers: float32 [k, 2, t, r], 2 for real
    and imaginary part, at k tones. The phase of the paths before_m [t] + after_m [r] is left out.
    Tubes are sorted by transmitter: those of t are starts[t]:starts[t + 1].

    factor complex64 [n]: multiplies each tube's amplitude, as does its row pair[n] of `reflection`,
    complex64 [pairs, k]; turns_per_m [k]: tones as f/c; middle: their middle; pattern: exponent q
    of the antennas' pattern cosᵠθ; seen [faces, r] float32: 1 where receiver r sees the face.

    A footprint over which the phase varies radiates less, by D = (1 + v/8)⁻⁴, where v is the
    variance of the phase over it at the middle frequency, with the phase taken as linear between
    the corners. This is the footprint's own pattern to second order (1 − v/2), and fades where a
    finer mesh would be needed. The path is the mean over the footprint for a quadratic phase: that
    at the middle plus a twelfth of the sum of the corners' differences from it.
    """
    samples = np.zeros((len(turns_per_m), 2, len(tx_m), len(rx_m)), np.float32)
    gain, path = np.empty(len(rx_m), np.float32), np.empty(len(rx_m), np.float32)
    receivers = np.stack((rx_m[:, 0], rx_m[:, 1], rx_m[:, 2], after_m)).astype(np.float32)
    eighth = np.float32((2 * np.pi * middle) ** 2 / 8)
    for t in range(len(tx_m)):
        for n in range(starts[t], starts[t + 1]):
            if tubes.root_m2[n] == 0:
                continue
            way = minus(vec(tubes.points_m[n, 0]), vec(tx_m[t]))
            distance = norm(way)
            amplitude = tubes.root_m2[n] / distance
            if pattern != 0:
                amplitude *= max(way[2] / distance, 0.0) ** pattern
            level, base = (
                np.float32(amplitude),
                np.float32(distance + tubes.length_m[n] - before_m[t]),
            )
            edges = (
                _single(tubes.edge_m[n, 0]),
                _single(tubes.edge_m[n, 1]),
                _single(tubes.edge_m[n, 2]),
            )
            tube = level, base, _single(tubes.points_m[n, -1]), _single(tubes.normal[n]), edges
            if not _arrive(
                *tube,
                _single(tubes.longer_m[n]),
                receivers,
                seen[tubes.faces[n, -1]],
                eighth,
                gain,
                path,
            ):
                continue
            if pattern != 0:
                for r in range(len(gain)):
                    towards = minus(vec(tubes.points_m[n, -1]), vec(rx_m[r]))
                    gain[r] *= max(towards[2] / norm(towards), 0.0) ** pattern
            for m in range(len(turns_per_m)):
                weight = factor[n] * reflection[pair[n], m]
                _add(
                    samples[m, 0, t],
                    samples[m, 1, t],
                    gain,
                    path,
                    weight,
                    np.float32(-turns_per_m[m]),
                )
    return samples


@njit(**INNER)
def _arrive(  # type: ignore[no-untyped-def]
    level, base, place, normal, edges, longer, receivers, sight, eighth, gain, path
):
    """Compute the amplitude and the path of a tube at every receiver, and write them to `gain` and
    `path` [r]. Returns whether the amplitude is large enough at any receiver.

    receivers [4, r]: x, y, z, and the path whose phase is left out. The loops here and in `_add`
    have no end that depends on their values, so that they become vector code.
    """
    zero, one, twelfth, clear = np.float32(0), np.float32(1), np.float32(1 / 12), np.float32(FAINT)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = edges
    count = zero
    for r in range(len(gain)):
        ux, uy, uz = (
            receivers[0, r] - place[0],
            receivers[1, r] - place[1],
            receivers[2, r] - place[2],
        )
        length = np.sqrt(ux * ux + uy * uy + uz * uz)
        scale = one / length
        ux, uy, uz = ux * scale, uy * scale, uz * scale
        a = longer[0] - ux * ax - uy * ay - uz * az
        b = longer[1] - ux * bx - uy * by - uz * bz
        c = longer[2] - ux * cx - uy * cy - uz * cz
        mean = (a + b + c) * twelfth
        path[r] = base + (length - receivers[3, r]) + mean
        fade = one / (
            one + eighth * ((a * a + b * b + c * c) * twelfth - np.float32(4) * mean * mean)
        )
        fade *= fade
        fade *= fade * sight[r]
        gain[r] = (
            level
            * scale
            * np.sqrt(max(normal[0] * ux + normal[1] * uy + normal[2] * uz, zero))
            * fade
        )
        count += one if fade >= clear else zero
    return count > zero


@njit(**INNER)
def _add(re, im, gain, path, weight, turns):  # type: ignore[no-untyped-def]
    """Add the wave of a tube at one tone to the samples of all receivers, with real part `re` and
    imaginary part `im` [r]. weight: complex amplitude of the wave; turns: −f/c."""
    real, imag = weight.real, weight.imag
    for r in range(len(re)):
        cosine, sine = cis_small(turns * path[r])
        re[r] += gain[r] * (real * cosine - imag * sine)
        im[r] += gain[r] * (real * sine + imag * cosine)


@njit(inline="always")
def _single(array):  # type: ignore[no-untyped-def]
    return np.float32(array[0]), np.float32(array[1]), np.float32(array[2])
