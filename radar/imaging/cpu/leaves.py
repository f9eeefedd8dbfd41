"""All leaves of a limb at once: packed, so that one call of compiled code images or simulates a whole limb."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from radar.imaging.cpu.chain import FAST, ascend, descend
from radar.imaging.cpu.leaf import Source, evaluate, radiate
from radar.imaging.tree import Node


class Leaves(NamedTuple):
    """The leaves of a node, packed: sizes [n, 8] as in `pack`, their arrays one after another in single and double."""

    sizes: np.ndarray
    single: np.ndarray
    double: np.ndarray


def pack(leaves: list[Node]) -> Leaves:
    """Nodes of the tree for the kernels."""
    sizes, single, double = [], [], []
    at_single = at_double = 0
    for leaf in leaves:
        floats = [leaf.tone_weights, *leaf.leg_weights]
        doubles = [leaf.box.centre_m, leaf.turns_per_m, *leaf.shifts_m]
        doubles += [array for leg in leaf.legs for array in (leg.length_m, leg.position_m)]
        counts = [len(leaf.turns_per_m), *(len(leg.length_m) for leg in leaf.legs)]
        sizes.append([*counts, *(array.size > 0 for array in floats), at_single, at_double])
        single += [array.ravel() for array in floats]
        double += [array.ravel() for array in doubles]
        at_single += sum(array.size for array in floats)
        at_double += sum(array.size for array in doubles)
    return Leaves(np.array(sizes, np.int64), np.concatenate(single), np.concatenate(double))


@numba.njit(**FAST)
def _weights(single, start, rows, columns, given):  # type: ignore[no-untyped-def]
    if given == 0:
        return single[:0].reshape(0, 0), start
    stop = start + rows * columns
    return single[start:stop].reshape(rows, columns), stop


@numba.njit(**FAST)
def _leaf(leaves, i, shape):  # type: ignore[no-untyped-def]
    """((weights of tones, a, b), (shifts of a, b), turns per metre, (centre, lengths and positions of a, b))."""
    k, n_a, n_b = leaves.sizes[i, 0], leaves.sizes[i, 1], leaves.sizes[i, 2]
    tones, at = _weights(leaves.single, leaves.sizes[i, 6], k, shape[0], leaves.sizes[i, 3])
    weights_a, at = _weights(leaves.single, at, n_a, shape[2], leaves.sizes[i, 4])
    weights_b, at = _weights(leaves.single, at, n_b, shape[3], leaves.sizes[i, 5])
    double, start = leaves.double, leaves.sizes[i, 7]
    centre = double[start : start + 3]
    turns = double[start + 3 : start + 3 + k]
    start += 3 + k
    shift_a, shift_b = double[start : start + shape[2]], double[start + shape[2] : start + shape[2] + shape[3]]
    start += shape[2] + shape[3]
    length_a, position_a = double[start : start + n_a], double[start + n_a : start + 4 * n_a].reshape(n_a, 3)
    start += 4 * n_a
    length_b, position_b = double[start : start + n_b], double[start + n_b : start + 4 * n_b].reshape(n_b, 3)
    antennas = (length_a, position_a, length_b, position_b)
    return (tones, weights_a, weights_b), (shift_a, shift_b), turns, (centre, *antennas)


@numba.njit(**FAST)
def gather(samples, turns_per_m, leaves, passes, reference_m, points_m, starts, count):  # type: ignore[no-untyped-def]
    """Images [count, n], of each of the k tones or of their sum, from a node's samples [k, 2, a, b] at its part of all
    points_m [3, …], sorted by leaves: leaf i holds starts[i]:starts[i + 1]."""
    images = np.empty((count, starts[-1] - starts[0]), np.complex64)
    for i in range(len(starts) - 1):
        if starts[i + 1] > starts[i]:
            (tones, w_a, w_b), (shift_a, shift_b), turns, (centre, length_a, position_a, length_b, position_b) = _leaf(
                leaves, i, samples.shape
            )
            below = descend(samples, turns_per_m, shift_a, shift_b, tones, w_a, w_b)
            first, last = starts[i], starts[i + 1]
            evaluate(
                below,
                points_m[:, first:last],
                centre,
                turns,
                position_a,
                length_a,
                position_b,
                length_b,
                passes,
                reference_m,
                images[:, first - starts[0] : last - starts[0]],
            )
    return images


@numba.njit(**FAST)
def scatter(source, turns_per_m, leaves, passes, reference_m, starts, shape):  # type: ignore[no-untyped-def]
    """The adjoint of `gather`: samples [k, 2, a, b] (shape) of a node from its part of all scatterers."""
    samples = np.zeros(shape, np.float32)
    for i in range(len(starts) - 1):
        if starts[i + 1] > starts[i]:
            (tones, w_a, w_b), (shift_a, shift_b), turns, (centre, length_a, position_a, length_b, position_b) = _leaf(
                leaves, i, samples.shape
            )
            part = _part(source, starts[i], starts[i + 1])
            leaf = radiate(part, centre, turns, position_a, length_a, position_b, length_b, passes, reference_m)
            samples += ascend(leaf, turns_per_m, shift_a, shift_b, tones, w_a, w_b)
    return samples


@numba.njit(**FAST)
def _part(source, start, stop):  # type: ignore[no-untyped-def]
    """The scatterers start:stop; empty arrays stay empty."""
    here = slice(start, stop)
    normal = source.normal if source.normal.shape[1] == 0 else source.normal[:, here]
    seen_a = source.seen_a if source.seen_a.size == 0 else source.seen_a[:, here]
    seen_b = source.seen_b if source.seen_b.size == 0 else source.seen_b[:, here]
    return Source(
        source.point_m[:, here],
        source.weight[here],
        source.delay_m[here],
        normal,
        source.spreading,
        source.pattern,
        seen_a,
        seen_b,
    )
