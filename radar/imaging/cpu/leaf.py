"""What happens in a leaf: its samples make the image at its points, and scatterers there make samples, the adjoint.

ΔR is formed in float64 against a reference point near the aperture; what is left of it differs little from antenna to
antenna, so that its phase can be formed in float32.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from radar.imaging.cpu.chain import FAST
from radar.imaging.cpu.steering import cis_small, cis_turns

BLOCK = 256  # points per matrix product, fewer where that would push the factors out of the second-level cache:
SECOND_LEVEL = 65536  # antennas × points


@numba.njit(**FAST)
def _differences(points_m, position_m, passes, length_m, centre_m, reference_m, out, common_m):  # type: ignore[no-untyped-def]
    """out[a, p] = ΔR_a(p) − ΔR_reference(p), small enough for float32; common_m [p] gains ΔR_reference(p)."""
    n = points_m.shape[1]
    cx, cy, cz = centre_m[0] - reference_m[0], centre_m[1] - reference_m[1], centre_m[2] - reference_m[2]
    at_centre = passes * np.sqrt(cx * cx + cy * cy + cz * cz)
    reference = np.empty(n)
    for p in range(n):
        dx, dy, dz = points_m[0, p] - reference_m[0], points_m[1, p] - reference_m[1], points_m[2, p] - reference_m[2]
        reference[p] = passes * np.sqrt(dx * dx + dy * dy + dz * dz) - at_centre
        common_m[p] += reference[p]
    for a in range(len(position_m)):
        ax, ay, az, length = position_m[a, 0], position_m[a, 1], position_m[a, 2], length_m[a]
        for p in range(n):
            dx, dy, dz = points_m[0, p] - ax, points_m[1, p] - ay, points_m[2, p] - az
            out[a, p] = passes * np.sqrt(dx * dx + dy * dy + dz * dz) - length - reference[p]


@numba.njit(**FAST)
def _steer(difference_m, turns_per_m, out):  # type: ignore[no-untyped-def]
    """out[2a, p]: real parts of exp(j2πfΔ/c) above imaginary parts; a negative f gives the conjugate."""
    n_a, n = difference_m.shape
    turns = np.float32(turns_per_m)
    for a in range(n_a):
        for p in range(n):
            out[a, p], out[n_a + a, p] = cis_small(turns * difference_m[a, p])


@numba.njit(**FAST)
def evaluate(
    samples, points_m, centre_m, turns_per_m, position_a, length_a, position_b, length_b, passes, reference_m, images
):  # type: ignore[no-untyped-def]
    """Images of a leaf's samples at its points_m [3, n]: complex64 images [k or 1, n]; one row sums all tones."""
    tones, _, n_a, n_b = samples.shape
    stacked = np.empty((2 * n_a, 2 * n_b), np.float32)
    block = max(min(BLOCK, SECOND_LEVEL // (n_a + n_b)), 16)
    for start in range(0, points_m.shape[1], block):
        stop = min(start + block, points_m.shape[1])
        n = stop - start
        points = points_m[:, start:stop].copy()  # contiguous: the loops over points become vector code
        common = np.zeros(n)
        delta_a, delta_b = np.empty((n_a, n), np.float32), np.empty((n_b, n), np.float32)
        _differences(points, position_a, passes[0], length_a, centre_m, reference_m[0], delta_a, common)
        _differences(points, position_b, passes[1], length_b, centre_m, reference_m[1], delta_b, common)
        a, b = np.empty((2 * n_a, n), np.float32), np.empty((2 * n_b, n), np.float32)
        total_re, total_im = np.zeros(n, np.float32), np.zeros(n, np.float32)
        for m in range(tones):
            _steer(delta_a, turns_per_m[m], a)
            _steer(delta_b, turns_per_m[m], b)
            for i in range(n_a):
                for k in range(n_b):
                    stacked[i, k] = stacked[n_a + i, n_b + k] = samples[m, 0, i, k]
                    stacked[n_a + i, k] = samples[m, 1, i, k]
                    stacked[i, n_b + k] = -samples[m, 1, i, k]
            u = np.dot(stacked, b)
            re, im = np.zeros(n, np.float32), np.zeros(n, np.float32)
            for i in range(n_a):
                for p in range(n):
                    re[p] += a[i, p] * u[i, p] - a[n_a + i, p] * u[n_a + i, p]
                    im[p] += a[i, p] * u[n_a + i, p] + a[n_a + i, p] * u[i, p]
            for p in range(n):
                cosine, sine = cis_turns(turns_per_m[m] * common[p])
                total_re[p] += cosine * re[p] - sine * im[p]
                total_im[p] += cosine * im[p] + sine * re[p]
            if len(images) > 1:
                for p in range(n):
                    images[m, start + p] = total_re[p] + np.complex64(1j) * total_im[p]
                total_re[:] = 0
                total_im[:] = 0
        if len(images) == 1:
            for p in range(n):
                images[0, start + p] = total_re[p] + np.complex64(1j) * total_im[p]


class Source(NamedTuple):
    """Scatterers sorted by leaf: point_m [3, n], weight [n] complex64, delay_m [n] one-way, normal [3, n] or [3, 0];
    spreading: whether legs have gains; pattern: exponent of cos θ in them; seen_a [a, n], seen_b [b, n]: which antennas
    see each point, or [0, 0] where all do (masks need a leaf that keeps all antennas)."""

    point_m: np.ndarray
    weight: np.ndarray
    delay_m: np.ndarray
    normal: np.ndarray
    spreading: bool
    pattern: float
    seen_a: np.ndarray
    seen_b: np.ndarray


@numba.njit(**FAST)
def radiate(source, centre_m, turns_per_m, position_a, length_a, position_b, length_b, passes, reference_m):  # type: ignore[no-untyped-def]
    """The adjoint of `evaluate`: what a leaf's scatterers add to its samples [k, 2, a, b]. `source`: a `Source`."""
    tones, n_a, n_b = len(turns_per_m), len(length_a), len(length_b)
    samples = np.zeros((tones, 2, n_a, n_b), np.float32)
    block = max(min(BLOCK, SECOND_LEVEL // (n_a + n_b)), 16)
    for start in range(0, source.point_m.shape[1], block):
        stop = min(start + block, source.point_m.shape[1])
        n = stop - start
        points = source.point_m[:, start:stop].copy()
        common = (passes[0] + passes[1]) * source.delay_m[start:stop]
        delta_a, delta_b = np.empty((n_a, n), np.float32), np.empty((n_b, n), np.float32)
        _differences(points, position_a, passes[0], length_a, centre_m, reference_m[0], delta_a, common)
        _differences(points, position_b, passes[1], length_b, centre_m, reference_m[1], delta_b, common)
        gain_a = _gains(source, start, points, position_a, source.seen_a)
        gain_b = _gains(source, start, points, position_b, source.seen_b)
        a, b = np.empty((2 * n_a, n), np.float32), np.empty((2 * n_b, n), np.float32)
        for m in range(tones):
            _steer(delta_a, -turns_per_m[m], a)
            _steer(delta_b, -turns_per_m[m], b)
            weight = np.empty((2, n), np.float32)
            for p in range(n):
                cosine, sine = cis_turns(-turns_per_m[m] * common[p])
                w = source.weight[start + p]
                weight[0, p] = w.real * cosine - w.imag * sine
                weight[1, p] = w.real * sine + w.imag * cosine
            for i in range(n_a):
                for p in range(n):
                    re, im = gain_a[i, p] * a[i, p], gain_a[i, p] * a[n_a + i, p]
                    a[i, p] = re * weight[0, p] - im * weight[1, p]
                    a[n_a + i, p] = re * weight[1, p] + im * weight[0, p]
            for i in range(n_b):
                for p in range(n):
                    b[i, p] *= gain_b[i, p]
                    b[n_b + i, p] *= gain_b[i, p]
            product = np.dot(a, b.T)
            for i in range(n_a):
                for k in range(n_b):
                    samples[m, 0, i, k] += product[i, k] - product[n_a + i, n_b + k]
                    samples[m, 1, i, k] += product[i, n_b + k] + product[n_a + i, k]
    return samples


@numba.njit(**FAST)
def _gains(source, start, points_m, position_m, seen):  # type: ignore[no-untyped-def]
    """g [a, p]: 1/R, times √(n·û) where the scatterers have normals and the antennas' cosᵠθ; 1 if nothing spreads; 0
    where an antenna sees nothing of a point."""
    n = points_m.shape[1]
    gain = np.ones((len(position_m), n), np.float32)
    if source.spreading:
        for a in range(len(position_m)):
            for p in range(n):
                dx = position_m[a, 0] - points_m[0, p]
                dy = position_m[a, 1] - points_m[1, p]
                dz = position_m[a, 2] - points_m[2, p]
                distance = np.sqrt(dx * dx + dy * dy + dz * dz)
                obliquity = 1.0
                if source.normal.shape[1] > 0:
                    i = start + p
                    along = source.normal[0, i] * dx + source.normal[1, i] * dy + source.normal[2, i] * dz
                    obliquity = max(along / distance, 0.0)
                gain[a, p] = np.sqrt(obliquity) / distance
                if source.pattern != 0.0:
                    gain[a, p] *= max(-dz / distance, 0.0) ** source.pattern
    if seen.size != 0:
        gain *= seen[:, start : start + n]
    return gain
