"""Fast simulation of point scatterers by the tree of boxes: scatterers → samples.

This is the exact adjoint of imaging by the same tree (`radar.imaging.cpu.forward`): conjugate
phases, transposed weights, and the steps in reverse order.
"""

import numpy as np

from handbench.radar.imaging.cpu.forward import apply, differences, inner_turn, mix
from handbench.radar.imaging.cpu.steering import cis_small
from handbench.support.compiled import FAST, INNER, njit


@njit(**FAST)
def to_parent(  # type: ignore[no-untyped-def]
    samples, turns_per_m, shift_a, shift_b, tone_weights, weights_a, weights_b
):
    """Compute what the samples [k', 2, a', b'] of a box contribute to the samples [k, 2, a, b] of
    its parent box: the adjoint of `forward.to_child`, with the same arguments."""
    spread = apply(weights_a.T.copy(), weights_b.T.copy(), samples)
    return inner_turn(
        mix(tone_weights.T.copy(), spread), turns_per_m, shift_a, shift_b, np.float32(-1.0)
    )


@njit(**FAST)
def radiate(points_m, gain_a, gain_b, place, passes, reference_m):  # type: ignore[no-untyped-def]
    """Compute the echo samples of a leaf (a smallest box) from scatterers in it, the adjoint of
    `forward.evaluate`: float32 [k, 2, a, b], 2 for real and imaginary part,

        S_k[a, b] = Σ_p g_a(p) g_b(p) exp(−j2πf_k(ΔR_a(p) + ΔR_b(p))/c).

    points_m [3, n]; gain_a [k or 1, 2, a, n], gain_b [k or 1, 2, b, n]: g_a and g_b, float32, 2 for
    real and imaginary part; place: the leaf's centre, tones and antennas, from its `Node`; passes
    [2]: how often the path goes between target and transmitter, and between target and receiver;
    reference_m [2, 3]: points near the antennas, to which path differences are computed.
    """
    centre_m, turns_per_m, (length_a, position_a), (length_b, position_b) = place
    n, n_a, n_b = points_m.shape[1], len(length_a), len(length_b)
    common = np.zeros(n)
    delta_a, delta_b = np.empty((n_a, n), np.float32), np.empty((n_b, n), np.float32)
    differences(
        points_m, position_a, passes[0], length_a, centre_m, reference_m[0], delta_a, common
    )
    differences(
        points_m, position_b, passes[1], length_b, centre_m, reference_m[1], delta_b, common
    )
    a, b = np.empty((2 * n_a, n), np.float32), np.empty((2 * n_b, n), np.float32)
    samples = np.empty((len(turns_per_m), 2, n_a, n_b), np.float32)
    phases, none = np.empty(n, np.float32), np.zeros(n, np.float32)
    for m in range(len(turns_per_m)):
        for p in range(n):
            turns = turns_per_m[m] * common[p]
            phases[p] = turns - np.rint(turns)
        _waves(delta_a, turns_per_m[m], phases, gain_a[m % len(gain_a)], a)
        _waves(delta_b, turns_per_m[m], none, gain_b[m % len(gain_b)], b)
        product = np.dot(a, b.T)
        for i in range(n_a):
            for j in range(n_b):
                samples[m, 0, i, j] = product[i, j] - product[n_a + i, n_b + j]
                samples[m, 1, i, j] = product[i, n_b + j] + product[n_a + i, j]
    return samples


@njit(**INNER)
def _waves(difference_m, turns_per_m, phases, gain, out):  # type: ignore[no-untyped-def]
    """Write g exp(−j2π(fΔ/c + t)) of path differences Δ [a, p], phases t [p] in turns and gains g
    [2, a, p] (real and imaginary part) to out [2a, p]: real parts above imaginary parts."""
    n_a, n = difference_m.shape
    per_m = np.float32(turns_per_m)
    for a in range(n_a):
        for p in range(n):
            cosine, sine = cis_small(per_m * difference_m[a, p] + phases[p])
            out[a, p] = gain[0, a, p] * cosine + gain[1, a, p] * sine
            out[n_a + a, p] = gain[1, a, p] * cosine - gain[0, a, p] * sine
