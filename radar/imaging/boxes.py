"""Fast imaging and simulation by the tree of boxes: samples → images of the points in a cell, and
scatterers → samples, the adjoint.

Samples are float32 arrays [tone, transmitter, re/im, receiver], of which real matrices combine any
axis without a copy. Each step from a box to a smaller box in it multiplies the samples by phases
and by real weights, which combine tones and antennas (`to_child`); `to_parent` is its adjoint. In a
leaf, a smallest box, phases come from differences ΔR between the paths to a point and to the box's
centre. ΔR is computed in float64, less that of a reference point near the aperture; the remainder
differs little between antennas, so float32 is enough for its phase.
"""

import math

import numpy as np
from scipy.spatial.distance import cdist

from handbench.radar.imaging.steering import cis_small, cis_turns
from handbench.radar.imaging.tree import Node, Step
from handbench.support.compiled import FAST, INNER, njit

# points per matrix product; fewer where the factors would exceed the second-level cache
BLOCK = 320
SECOND_LEVEL = 65536  # antennas × points
# points are padded to multiples of this, for vector code
VECTOR = 32


def to_child(samples: np.ndarray, turns_per_m: np.ndarray, step: Step) -> np.ndarray:
    """Compute the samples M of a box [m, a, 2, b], 2 for real and imaginary part, from those of its
    parent box, S [f, t, 2, r], for tones, transmitters and receivers:

        M[m, a, b] = Σ_f Σ_t Σ_r L[m, f] X[a, t] Y[b, r] exp(j2πf(Δ_t + Δ_r)/c) S[f, t, r].

    turns_per_m [f]: f/c of the parent's tones; step: Δ, L, X and Y. A step to n boxes of one parent
    has one more axis [n], and so has the result.
    """
    return _combined(
        _turned(samples, turns_per_m, step.shift_a, step.shift_b),
        step.of_tones,
        step.of_a,
        step.of_b,
    )


def to_parent(samples: np.ndarray, turns_per_m: np.ndarray, step: Step) -> np.ndarray:
    """Compute what the samples [m, a, 2, b] of a box contribute to those of its parent box, [f, t,
    2, r]: the adjoint of `to_child`, with the same arguments."""
    combined = _combined(samples, step.of_tones.T, step.of_a.T, step.of_b.T)
    return _turned(combined, -turns_per_m, step.shift_a, step.shift_b)


def _turned(
    samples: np.ndarray, turns_per_m: np.ndarray, shift_a: np.ndarray, shift_b: np.ndarray
) -> np.ndarray:
    turned = np.empty((*shift_a.shape[:-1], *samples.shape), np.float32)
    shifts = (shift.reshape(-1, shift.shape[-1]) for shift in (shift_a, shift_b))
    _turn(samples, turns_per_m, *shifts, turned.reshape(-1, *samples.shape))
    return turned


@njit(**FAST)
def _turn(samples, turns_per_m, shift_a, shift_b, out):  # type: ignore[no-untyped-def]
    b_re, b_im = np.empty(shift_b.shape[1], np.float32), np.empty(shift_b.shape[1], np.float32)
    for i in range(len(out)):
        for m in range(len(turns_per_m)):
            for b in range(len(b_re)):
                b_re[b], b_im[b] = cis_turns(turns_per_m[m] * shift_b[i, b])
            for a in range(shift_a.shape[1]):
                a_re, a_im = cis_turns(turns_per_m[m] * shift_a[i, a])
                for b in range(len(b_re)):
                    re, im = a_re * b_re[b] - a_im * b_im[b], a_re * b_im[b] + a_im * b_re[b]
                    out[i, m, a, 0, b] = samples[m, a, 0, b] * re - samples[m, a, 1, b] * im
                    out[i, m, a, 1, b] = samples[m, a, 0, b] * im + samples[m, a, 1, b] * re


def _combined(
    samples: np.ndarray, of_tones: np.ndarray, of_a: np.ndarray, of_b: np.ndarray
) -> np.ndarray:
    *boxes, tones, n_a, _, n_b = samples.shape
    if of_tones.size:
        samples = of_tones @ samples.reshape(*boxes, tones, -1)
    samples = samples.reshape(*boxes, -1, n_a, 2 * n_b)
    if of_a.size:
        samples = of_a[..., None, :, :] @ samples
    rows = samples.reshape(*boxes, -1, n_b)
    if of_b.size:
        rows = rows @ of_b.swapaxes(-1, -2)
    return rows.reshape(*samples.shape[:-1], 2, -1)


@njit(**FAST)
def gather(  # type: ignore[no-untyped-def]
    samples, counts, centre_m, turns_per_m, legs, passes, reference_m, points_m, starts, images
):
    """Image the points of n leaves from their samples [n, k, a, 2, b].

    counts to legs: their `NodeStack`'s, of each leg the lengths and positions; points_m [3, p]: all
    points, of which starts[i]:starts[i + 1] are in leaf i. The result is written to the same
    columns of `images`, complex64: [k, p] for one image per tone, or [1, p] for the sum of all
    tones.
    """
    for i in range(len(counts)):
        tones, n_a, n_b = counts[i, 0], counts[i, 1], counts[i, 2]
        count = starts[i + 1] - starts[i]
        blocks = math.ceil(count / max(min(BLOCK, SECOND_LEVEL // (n_a + n_b)), VECTOR))
        # of even blocks, the last one filled up with its last point
        n = VECTOR * math.ceil(count / (blocks * VECTOR))
        points = np.empty((3, n))  # contiguous: the loops over points become vector code
        reference, phases = np.empty((2, n)), np.empty(n, np.float32)
        difference_m = np.empty((n_a + n_b, n), np.float32)
        waves = np.empty((2 * (n_a + n_b), n), np.float32)
        stacked, u = np.empty((2 * n_a, 2 * n_b), np.float32), np.empty((2 * n_a, n), np.float32)
        re, im = np.empty(n, np.float32), np.empty(n, np.float32)
        for start in range(0, count, n):
            here, held = starts[i] + start, min(count - start, n)
            for p in range(n):
                for axis in range(3):
                    points[axis, p] = points_m[axis, here + min(p, held - 1)]
            for leg in range(2):
                length_m, position_m = legs[leg]
                differences(
                    points,
                    position_m[i],
                    passes[leg],
                    length_m[i],
                    centre_m[i],
                    reference_m[leg],
                    difference_m[leg * n_a : n_a + leg * n_b],
                    reference[leg],
                )
            re[:] = 0
            im[:] = 0
            for m in range(tones):
                for leg in range(2):
                    n_leg = counts[i, 1 + leg]
                    first, per_m = leg * n_a, np.float32(turns_per_m[i, m])
                    for p in range(n):
                        turns = turns_per_m[i, m] * reference[leg, p]
                        phases[p] = turns - np.rint(turns)
                    for a in range(n_leg):
                        for p in range(n):
                            turn = per_m * difference_m[first + a, p] + phases[p]
                            waves[2 * first + a, p], waves[2 * first + n_leg + a, p] = cis_small(
                                turn
                            )
                # Σ_a Σ_b of the waves and the samples, with complex numbers as real matrices
                for a in range(n_a):
                    for b in range(n_b):
                        stacked[a, b] = stacked[n_a + a, n_b + b] = samples[i, m, a, 0, b]
                        stacked[n_a + a, b] = samples[i, m, a, 1, b]
                        stacked[a, n_b + b] = -stacked[n_a + a, b]
                np.dot(stacked, waves[2 * n_a :], u)
                for a in range(n_a):
                    for p in range(n):
                        re[p] += waves[a, p] * u[a, p] - waves[n_a + a, p] * u[n_a + a, p]
                        im[p] += waves[a, p] * u[n_a + a, p] + waves[n_a + a, p] * u[a, p]
                if m + 1 == tones or len(images) > 1:
                    for p in range(held):
                        images[m % len(images), here + p] = complex(re[p], im[p])
                    re[:] = 0
                    im[:] = 0


def radiate(
    points_m: np.ndarray,
    distances_m: list[np.ndarray],
    gains: list[np.ndarray],
    leaf: Node,
    passes: np.ndarray,
    reference_m: np.ndarray,
) -> np.ndarray:
    """Compute the echo samples of a leaf (a smallest box) from scatterers in it, the adjoint of
    `gather`: [k, a, 2, b], 2 for real and imaginary part,

        S_k[a, b] = Σ_p g_a(p) g_b(p) exp(−j2πf_k(ΔR_a(p) + ΔR_b(p))/c).

    points_m [n, 3]; distances_m: from the leaf's transmitters [a, n] and receivers [b, n]; gains:
    g_a [k or 1, 2, a, n] and g_b [k or 1, 2, b, n], float32, 2 for real and imaginary part; passes
    [2]: how often the path goes between target and transmitter, and between target and receiver;
    reference_m [2, 3]: points near the antennas, to which path differences are computed.
    """
    waves, per_m = [], leaf.turns_per_m.astype(np.float32)
    references_m = cdist(reference_m, points_m) - cdist(reference_m, leaf.box.centre_m[None])
    for leg, (distance_m, gain) in enumerate(zip(distances_m, gains, strict=True)):
        reference = passes[leg] * references_m[leg]
        difference_m = passes[leg] * distance_m - leaf.lengths_m[leg][:, None] - reference
        turns = leaf.turns_per_m[:, None] * reference
        phases = (turns - np.rint(turns)).astype(np.float32)
        wave = np.empty((len(per_m), 2 * len(distance_m), len(points_m)), np.float32)
        _waves(difference_m.astype(np.float32), phases, per_m, gain, wave)
        waves.append(wave)
    n_a, n_b = (wave.shape[1] // 2 for wave in waves)
    product = waves[0] @ waves[1].swapaxes(1, 2)
    re = product[:, :n_a, :n_b] - product[:, n_a:, n_b:]
    im = product[:, :n_a, n_b:] + product[:, n_a:, :n_b]
    return np.stack([re, im], axis=2)


@njit(**FAST)
def _waves(difference_m, phases, turns_per_m, gain, out):  # type: ignore[no-untyped-def]
    """Write g exp(−j2πfΔR/c) of the antennas of a leg to out [k, 2a, n]: real parts above imaginary
    parts. difference_m [a, n]: ΔR less that of the reference point, whose phases, in turns, are
    phases [k, n]; gain: g [k or 1, 2, a, n]."""
    for m in range(len(out)):
        per_m, g = turns_per_m[m], gain[m % len(gain)]
        for a in range(len(difference_m)):
            for p in range(phases.shape[1]):
                cosine, sine = cis_small(per_m * difference_m[a, p] + phases[m, p])
                out[m, a, p] = g[0, a, p] * cosine + g[1, a, p] * sine
                out[m, len(difference_m) + a, p] = g[1, a, p] * cosine - g[0, a, p] * sine


@njit(**INNER)
def differences(  # type: ignore[no-untyped-def]
    points_m, position_m, passes, length_m, centre_m, reference_m, out, reference
):
    """Compute path differences that are small enough for float32: out[a, p] = ΔR_a(p) −
    ΔR_reference(p), metres, for the first antennas of position_m.

    ΔR is the path from an antenna, or from the reference point, to point p, less the path to the
    box's centre. ΔR_reference(p) is written to reference [p].
    """
    n = points_m.shape[1]
    cx, cy, cz = (
        centre_m[0] - reference_m[0],
        centre_m[1] - reference_m[1],
        centre_m[2] - reference_m[2],
    )
    at_centre = passes * math.sqrt(cx * cx + cy * cy + cz * cz)
    for p in range(n):
        dx, dy, dz = (
            points_m[0, p] - reference_m[0],
            points_m[1, p] - reference_m[1],
            points_m[2, p] - reference_m[2],
        )
        reference[p] = passes * math.sqrt(dx * dx + dy * dy + dz * dz) - at_centre
    for a in range(len(out)):
        ax, ay, az, length = position_m[a, 0], position_m[a, 1], position_m[a, 2], length_m[a]
        for p in range(n):
            dx, dy, dz = points_m[0, p] - ax, points_m[1, p] - ay, points_m[2, p] - az
            out[a, p] = passes * math.sqrt(dx * dx + dy * dy + dz * dz) - length - reference[p]
