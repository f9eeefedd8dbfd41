"""Fast imaging by the tree of boxes: samples → images of the points in a cell.

Samples are float32 arrays [tone, re/im, transmitter, receiver], because products of real matrices
are faster here than complex ones. Each step from a box to a smaller box in it multiplies the
samples by phases and by real weights, which combine tones and antennas. In a leaf, a smallest box,
phases come from differences ΔR between the paths to a point and to the box's centre. ΔR is computed
in float64, less that of a reference point near the aperture; the remainder differs little between
antennas, so float32 is enough for its phase.
"""

import math

import numpy as np

from handbench.radar.imaging.cpu.steering import cis_small, cis_turns
from handbench.support.compiled import FAST, INNER, njit, outer

# points per matrix product; fewer where the factors would exceed the second-level cache
BLOCK = 320
SECOND_LEVEL = 65536  # antennas × points
# points are padded to multiples of this, for vector code
VECTOR = 32


def planes(samples: np.ndarray) -> np.ndarray:
    """Convert complex samples to float32 with the real and the imaginary part as second axis: [k,
    t, r] → [k, 2, t, r], or [k, n] of a scan → [k, 2, n, 1]."""
    parts = np.ascontiguousarray(np.stack([samples.real, samples.imag], axis=1), np.float32)
    return parts[..., None] if parts.ndim == 3 else parts


def complex_samples(parts: np.ndarray) -> np.ndarray:
    """Convert samples [k, 2, t, r], whose second axis has real and imaginary part, to complex64 [k,
    t, r]."""
    return parts[:, 0] + np.complex64(1j) * parts[:, 1]


@njit(**FAST)
def gather(  # type: ignore[no-untyped-def]
    samples, turns_per_m, leaves, passes, reference_m, points_m, starts, images
):
    """Image the points of some leaves of a cell from the cell's samples [k, 2, a, b], 2 for real
    and imaginary part.

    turns_per_m [k]: f/c of the cell's tones; leaves: `NodeStack`; points_m [3, n]: all points, of
    which starts[i]:starts[i + 1] are in leaf i. The result is written to the same columns of
    `images`, complex64: [k, n] for one image per tone, or [1, n] for the sum of all tones.
    """
    (weights_a, shift_a, length_a, position_a), (weights_b, shift_b, length_b, position_b) = (
        leaves.legs
    )
    for i in range(len(leaves.counts)):
        if starts[i] == starts[i + 1]:
            continue
        k, a, b = leaves.counts[i, 0], leaves.counts[i, 1], leaves.counts[i, 2]
        below = inner_to_child(
            samples,
            turns_per_m,
            shift_a[i],
            shift_b[i],
            leaves.tone_weights[i, :k],
            weights_a[i, :a],
            weights_b[i, :b],
        )
        evaluate(
            below,
            points_m[:, starts[i] : starts[i + 1]],
            leaves.centre_m[i],
            leaves.turns_per_m[i, :k],
            (length_a[i, :a], position_a[i, :a]),
            (length_b[i, :b], position_b[i, :b]),
            passes,
            reference_m,
            images[:, starts[i] : starts[i + 1]],
        )


@njit(**INNER)
def inner_to_child(  # type: ignore[no-untyped-def]
    samples, turns_per_m, shift_a, shift_b, tone_weights, weights_a, weights_b
):
    """Compute the samples of a box from the samples [k, 2, a, b] of its parent box, for k tones,
    real and imaginary part, a transmitters and b receivers.

    Phases of the paths shift_a [a] and shift_b [b] (metres) change the reference point to the box's
    centre; then real weights combine tones and antennas. Empty weights leave their axis unchanged.
    """
    return apply(
        weights_a,
        weights_b,
        mix(tone_weights, inner_turn(samples, turns_per_m, shift_a, shift_b, np.float32(1.0))),
    )


to_child = outer(inner_to_child)


@njit(**INNER)
def inner_turn(samples, turns_per_m, shift_a, shift_b, sign):  # type: ignore[no-untyped-def]
    """Multiply samples [k, 2, a, b] (2: real and imaginary part) by the phase factors
    exp(±j2πf(shift_a + shift_b)/c). shift_a [a], shift_b [b]: path lengths in metres; turns_per_m
    [k]: f/c; sign: 1 or −1."""
    out = np.empty_like(samples)
    tones, _, n_a, n_b = samples.shape
    b_re, b_im = np.empty(n_b, np.float32), np.empty(n_b, np.float32)
    for m in range(tones):
        for b in range(n_b):
            b_re[b], b_im[b] = cis_turns(turns_per_m[m] * shift_b[b])
        for a in range(n_a):
            a_re, a_im = cis_turns(turns_per_m[m] * shift_a[a])
            for b in range(n_b):
                re, im = a_re * b_re[b] - a_im * b_im[b], sign * (a_re * b_im[b] + a_im * b_re[b])
                out[m, 0, a, b] = samples[m, 0, a, b] * re - samples[m, 1, a, b] * im
                out[m, 1, a, b] = samples[m, 0, a, b] * im + samples[m, 1, a, b] * re
    return out


@njit(**INNER)
def mix(weights, samples):  # type: ignore[no-untyped-def]
    if weights.size == 0:
        return samples
    tones, _, n_a, n_b = samples.shape
    return np.dot(weights, samples.reshape(tones, 2 * n_a * n_b)).reshape(len(weights), 2, n_a, n_b)


@njit(**INNER)
def apply(weights_a, weights_b, samples):  # type: ignore[no-untyped-def]
    """Combine the antennas of samples [k, 2, a, b] with real weights [n, a] of transmitters and [m,
    b] of receivers: [k, 2, n, m]. Empty weights leave their axis unchanged."""
    tones, _, n_a, n_b = samples.shape
    if weights_b.size != 0:
        samples = np.dot(samples.reshape(2 * tones * n_a, n_b), weights_b.T).reshape(
            tones, 2, n_a, len(weights_b)
        )
    if weights_a.size == 0:
        return samples
    out = np.empty((tones, 2, len(weights_a), samples.shape[3]), np.float32)
    for m in range(tones):
        for part in range(2):
            np.dot(weights_a, samples[m, part], out[m, part])
    return out


@njit(**INNER)
def evaluate(  # type: ignore[no-untyped-def]
    samples, points_m, centre_m, turns_per_m, leg_a, leg_b, passes, reference_m, images
):
    """Image the points_m [3, n] of a leaf (a smallest box) from the leaf's samples [k, 2, a, b],
    and write the result to `images`, complex64: [k, n] for one image per tone, or [1, n] for the
    sum of all tones. leg_a, leg_b: path lengths to the leaf's centre and
    positions of transmitters and of receivers."""
    tones, _, n_a, n_b = samples.shape
    (length_a, position_a), (length_b, position_b) = leg_a, leg_b
    count = points_m.shape[1]
    blocks = math.ceil(count / max(min(BLOCK, SECOND_LEVEL // (n_a + n_b)), VECTOR))
    # of even blocks, the last one filled up with its last point
    n = VECTOR * math.ceil(count / (blocks * VECTOR))
    points = np.empty((3, n))  # contiguous: the loops over points become vector code
    for start in range(0, count, n):
        held = min(count - start, n)
        for p in range(n):
            for axis in range(3):
                points[axis, p] = points_m[axis, min(start + p, count - 1)]
        common = np.zeros(n)
        delta_a, delta_b = np.empty((n_a, n), np.float32), np.empty((n_b, n), np.float32)
        differences(
            points, position_a, passes[0], length_a, centre_m, reference_m[0], delta_a, common
        )
        differences(
            points, position_b, passes[1], length_b, centre_m, reference_m[1], delta_b, common
        )
        a, b = np.empty((2 * n_a, n), np.float32), np.empty((2 * n_b, n), np.float32)
        stacked, u = np.empty((2 * n_a, 2 * n_b), np.float32), np.empty((2 * n_a, n), np.float32)
        total_re, total_im = np.zeros(n, np.float32), np.zeros(n, np.float32)
        for m in range(tones):
            steer(delta_a, turns_per_m[m], a)
            steer(delta_b, turns_per_m[m], b)
            product = bilinear(a, samples[m], b, stacked, u)
            for p in range(n):
                cosine, sine = cis_turns(turns_per_m[m] * common[p])
                total_re[p] += cosine * product[0, p] - sine * product[1, p]
                total_im[p] += cosine * product[1, p] + sine * product[0, p]
            if len(images) > 1:
                for p in range(held):
                    images[m, start + p] = total_re[p] + np.complex64(1j) * total_im[p]
                total_re[:] = 0
                total_im[:] = 0
        if len(images) == 1:
            for p in range(held):
                images[0, start + p] = total_re[p] + np.complex64(1j) * total_im[p]


@njit(**INNER)
def bilinear(a, samples, b, stacked, u):  # type: ignore[no-untyped-def]
    """Compute the double sum Σ_i Σ_j a_i S_ij b_j over transmitters and receivers at every point:
    float32 [2, p], real and imaginary part.

    a [2a, p], b [2b, p]: waves of transmitters and of receivers, real parts above imaginary parts;
    samples [2, a, b]: S; stacked [2a, 2b] and u [2a, p]: scratch arrays.
    """
    n_a, n_b = samples.shape[1:]
    for i in range(n_a):  # loops, since slices take seconds to compile
        for j in range(n_b):
            stacked[i, j] = stacked[n_a + i, n_b + j] = samples[0, i, j]
            stacked[n_a + i, j], stacked[i, n_b + j] = samples[1, i, j], -samples[1, i, j]
    np.dot(stacked, b, u)
    out = np.zeros((2, a.shape[1]), np.float32)
    for i in range(n_a):
        for p in range(a.shape[1]):
            out[0, p] += a[i, p] * u[i, p] - a[n_a + i, p] * u[n_a + i, p]
            out[1, p] += a[i, p] * u[n_a + i, p] + a[n_a + i, p] * u[i, p]
    return out


@njit(**INNER)
def differences(  # type: ignore[no-untyped-def]
    points_m, position_m, passes, length_m, centre_m, reference_m, out, common_m
):
    """Compute path differences that are small enough for float32: out[a, p] = ΔR_a(p) −
    ΔR_reference(p), metres.

    ΔR is the path from an antenna, or from the reference point, to point p, less the path to the
    box's centre. ΔR_reference(p) is added to common_m [p].
    """
    n = points_m.shape[1]
    cx, cy, cz = (
        centre_m[0] - reference_m[0],
        centre_m[1] - reference_m[1],
        centre_m[2] - reference_m[2],
    )
    at_centre = passes * np.sqrt(cx * cx + cy * cy + cz * cz)
    reference = np.empty(n)
    for p in range(n):
        dx, dy, dz = (
            points_m[0, p] - reference_m[0],
            points_m[1, p] - reference_m[1],
            points_m[2, p] - reference_m[2],
        )
        reference[p] = passes * np.sqrt(dx * dx + dy * dy + dz * dz) - at_centre
        common_m[p] += reference[p]
    for a in range(len(position_m)):
        ax, ay, az, length = position_m[a, 0], position_m[a, 1], position_m[a, 2], length_m[a]
        for p in range(n):
            dx, dy, dz = points_m[0, p] - ax, points_m[1, p] - ay, points_m[2, p] - az
            out[a, p] = passes * np.sqrt(dx * dx + dy * dy + dz * dz) - length - reference[p]


@njit(**INNER)
def steer(difference_m, turns_per_m, out):  # type: ignore[no-untyped-def]
    """Write exp(j2πfΔ/c) of path differences Δ [a, p], metres, to out [2a, p]: real parts above
    imaginary parts. turns_per_m: f/c; negative for the conjugate."""
    n_a, n = difference_m.shape
    turns = np.float32(turns_per_m)
    for a in range(n_a):
        for p in range(n):
            out[a, p], out[n_a + a, p] = cis_small(turns * difference_m[a, p])
