"""Fast simulation of point scatterers by the tree of boxes: scatterers → samples, the adjoint of
imaging by the same tree (`radar.imaging.cpu.forward`)."""

import numpy as np

from handbench.radar.imaging.cpu.forward import differences
from handbench.radar.imaging.cpu.steering import cis_small
from handbench.radar.imaging.tree import Node
from handbench.support.compiled import FAST, njit


def radiate(
    points_m: np.ndarray,
    gains: list[np.ndarray],
    leaf: Node,
    passes: np.ndarray,
    reference_m: np.ndarray,
) -> np.ndarray:
    """Compute the echo samples of a leaf (a smallest box) from scatterers in it, the adjoint of
    `forward.gather`: [k, a, 2, b], 2 for real and imaginary part,

        S_k[a, b] = Σ_p g_a(p) g_b(p) exp(−j2πf_k(ΔR_a(p) + ΔR_b(p))/c).

    points_m [3, n]; gains: g_a [k or 1, 2, a, n] and g_b [k or 1, 2, b, n], float32, 2 for real and
    imaginary part; passes [2]: how often the path goes between target and transmitter, and between
    target and receiver; reference_m [2, 3]: points near the antennas, to which path differences are
    computed.
    """
    waves = []
    for leg, gain in enumerate(gains):
        position_m, n = leaf.legs[leg].position_m, points_m.shape[1]
        wave = np.empty((len(leaf.turns_per_m), 2 * len(position_m), n), np.float32)
        at = position_m, passes[leg], leaf.lengths_m[leg], leaf.box.centre_m, reference_m[leg]
        _waves(points_m, *at, leaf.turns_per_m, gain, wave)
        waves.append(wave)
    n_a, n_b = (wave.shape[1] // 2 for wave in waves)
    product = waves[0] @ waves[1].swapaxes(1, 2)
    re = product[:, :n_a, :n_b] - product[:, n_a:, n_b:]
    im = product[:, :n_a, n_b:] + product[:, n_a:, :n_b]
    return np.stack([re, im], axis=2)


@njit(**FAST)
def _waves(  # type: ignore[no-untyped-def]
    points_m, position_m, passes, length_m, centre_m, reference_m, turns_per_m, gain, out
):
    """Write g exp(−j2πfΔR/c) of the antennas of a leg to out [k, 2a, n]: real parts above imaginary
    parts."""
    n_a, n = len(position_m), points_m.shape[1]
    reference, phases = np.empty(n), np.empty(n, np.float32)
    difference_m = np.empty((n_a, n), np.float32)
    differences(
        points_m, position_m, passes, length_m, centre_m, reference_m, difference_m, reference
    )
    for m in range(len(turns_per_m)):
        per_m, g = np.float32(turns_per_m[m]), gain[m % len(gain)]
        for p in range(n):
            turns = turns_per_m[m] * reference[p]
            phases[p] = turns - np.rint(turns)
        for a in range(n_a):
            for p in range(n):
                cosine, sine = cis_small(per_m * difference_m[a, p] + phases[p])
                out[m, a, p] = g[0, a, p] * cosine + g[1, a, p] * sine
                out[m, n_a + a, p] = g[1, a, p] * cosine - g[0, a, p] * sine
