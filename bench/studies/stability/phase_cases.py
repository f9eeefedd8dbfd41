"""Hard phases: at and across each pair's ambiguity, pairs of tones too close and too far apart."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product
from typing import Any

import numpy as np

import bench.studies.stability.phase_targets  # noqa: F401  the other half of the group
from bench.studies.stability.cases import Refused, Worst, case, refused, worst
from bench.studies.stability.scenes import (
    LADDER_HZ,
    POINT_M,
    bumpy_points,
    capture,
    depth_map,
    echoes,
    judged,
    middle,
    noisy,
)
from radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from radar.data.depthmap import DepthMap
from radar.methods.confidence import wrap_probability
from radar.methods.fsk import depth_step_m

C = SPEED_OF_LIGHT_M_S
PAIRS_HZ = (0.2e9, 0.5e9, 0.7e9, 2.3e9, 2.5e9, 9.8e9, 10e9)
PAPER_HZ = (82.0e9, 81.8e9, 79.5e9)
PERIOD_M = C / (2 * 2.5e9)
CELL_M = 0.006  # resolution cell at 0.3 m


def _point_at(z_m: float) -> np.ndarray:
    return echoes((0.0, 0.0, z_m), frequencies_hz=LADDER_HZ)


def _found(id: str, z_m: float, **values: Any) -> DepthMap:
    return depth_map(id, capture(_point_at(z_m), LADDER_HZ), **values)


@case(
    "phase",
    "a step at and across ±c/4Δf",
    quantity="error of the phase, periods apart",
    reference="4πΔf·Δz/c wrapped, in long double",
    unit="rad",
    bound=2.0**-23,
    reason="each image rounds to single precision: 2⁻²⁴ rad at most, of two images 2⁻²³",
)
def across() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        share = np.array([0, 0.1, 0.3, 0.5, 0.77, 1 - 1e-6, 1 - 2**-24, 1, 1 + 2**-24, 1 + 1e-6, 1.5, 2, 3])
        for difference_hz, sign in product(PAIRS_HZ, (-1, 1)):
            turns = np.longdouble(sign) * share.astype(np.longdouble) / 2  # of the phase, from the step −Δz
            phase = 2 * np.pi * (turns - np.rint(turns)).astype(np.float64)
            image, one = np.exp(1j * phase).astype(np.complex64), np.ones(len(share), np.complex64)
            step_m = depth_step_m(image, one, difference_hz)
            off = step_m * 4 * np.pi * difference_hz / C + phase
            yield f"Δf {difference_hz / 1e9:g} GHz", float(np.abs(off - 2 * np.pi * np.rint(off / 2 / np.pi)).max())

    return worst(seen())


@case(
    "phase",
    "the probability of a wrap at the ambiguity",
    quantity="wrap_probability",
    unit="1",
    reference="two Gaussian hypotheses, in long double",
    bound=1e-12,
    reason="its exponent 2a(a − |Δz|)/σ² rounds by a few 2⁻⁵³ of up to 700, beyond which the answer is 0 or 1 itself",
)
def wraps_at() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        step = np.array([0, 29.9, 30 - 1e-9, 30, 30 + 1e-9, 30.1, 60, 300])
        for sigma in (0.0, 1e-300, 1e-9, 1e-3, 1.0, 30.0, 1e9):
            found = wrap_probability(step, np.full(len(step), sigma), 30.0)
            with np.errstate(all="ignore"):
                exponent = 60 * (30 - step.astype(np.longdouble)) / np.longdouble(sigma) ** 2
                exact = 1 / (1 + np.exp(exponent))
            exact = np.where(step == 30, 0.5, exact)  # halfway: either period, however well the point is known
            yield f"σ {sigma:g} mm", float(np.abs(found - exact).max())

    return worst(seen())


@case(
    "phase",
    "the coarse error across ±30 mm",
    quantity="depth off by half a period without flag",
    reference="two planes a step apart",
    unit="mm",
    bound=1e3 * PERIOD_M / 2,
    reason="a filter across the edge is off by up to half the step; beyond 30 mm the third tone adds a period, which "
    "must be flagged; no pixel without flag is off by more than half of one. Pixels a resolution cell from the edge: "
    "nearer ones see both planes in one phase",
)
def coarse_error() -> Worst:
    seen = []
    for height_mm in (20, 40, 60, 65, 70, 75, 80, 85, 90, 95, 100, 110):
        far_m = 0.26 + height_mm / 1000
        along = np.arange(-0.027, 0.0271, 0.006)
        x, y = np.meshgrid(along, along)
        points = np.stack([x, y, np.where(x < 0, 0.26, far_m)], axis=-1).reshape(-1, 3)
        taken = capture(echoes(points, None, PAPER_HZ, qar50()), PAPER_HZ, qar50())  # a thin array's lobes would meddle
        for size in (15, 31):
            values = {"coarse_filter_px": size, "fine_filter_px": 1, "first_depth_m": 0.3}
            depth = depth_map("3fsk", taken, half_m=0.024, **values)
            beside = np.abs(depth.z_m - np.where(depth.x_m < 0, 0.26, far_m))[:, np.abs(depth.x_m) > CELL_M]
            for marked in (False, True):
                there = beside[np.isfinite(beside) & (depth.wrapped[:, np.abs(depth.x_m) > CELL_M] == marked)]
                seen.append((f"step {height_mm} mm, filter {size}", 1e3 * there.max(initial=0.0), marked))
    return judged(seen, 1e3 * PERIOD_M / 2)


@case(
    "phase",
    "wrapped pixels are dropped",
    quantity="flagged pixels that keep a depth",
    reference="none",
    unit="pixels",
    bound=0.0,
    reason="drop_wrapped takes the depth of every flagged pixel, before the filter could spread it",
)
def dropped() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        clean = echoes(bumpy_points(), frequencies_hz=LADDER_HZ)
        for snr_db, seed in product((40, 25, 15, 5), range(3)):
            taken = capture(noisy(clean, 900.0, snr_db, seed), LADDER_HZ)
            depth = depth_map("3fsk-plus", taken, half_m=0.02, first_depth_m=0.28, tolerance=None)
            yield f"{snr_db} dB, draw {seed}", float(np.count_nonzero(np.isfinite(depth.z_m) & depth.wrapped))

    return worst(seen())


@case(
    "phase",
    "a pair of tones that meet",
    quantity="error of the depth, over cΔφ/4πΔf of a rounding Δφ",
    reference="the point",
    unit="rad",
    bound=2.0**-20,
    reason="samples, both steerings and the image round to single precision, 2⁻²³ rad each and tone, 8 in all; the "
    "last micrometre is the factor 2's",
)
def tones_meet() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        for difference_hz in (2e8, 2e7, 2e6, 2e5, 2e4, 2e3, 2e2, 20.0):
            tones = np.array([82e9, 82e9 - difference_hz])
            taken = capture(echoes(POINT_M, frequencies_hz=tones), tones)
            depth = depth_map("2fsk", taken, f1_hz=tones[0], f2_hz=tones[1], tolerance=None, first_depth_m=0.28)
            metres = C / (4 * np.pi * difference_hz)
            yield f"Δf {difference_hz:g} Hz", max(abs(float(middle(depth.z_m)) - 0.28) - 1e-6, 0.0) / metres

    return worst(seen())


@case(
    "phase",
    "equal tones",
    quantity="depth from Δf = 0",
    reference="a refusal",
    unit="mm",
    bound=0.0,
    reason="φ/Δf has no value; every pair of a method, and a capture that lists a tone twice, must be refused",
)
def equal_tones() -> Refused | Worst:
    taken = capture(_point_at(0.28), LADDER_HZ)
    twice = np.array([82e9, 82e9, 79.5e9])
    listed = capture(echoes(POINT_M, frequencies_hz=twice), twice)
    answers = [
        refused(lambda: depth_map("2fsk", taken, f2_hz=82e9), "same measured tone"),
        refused(lambda: depth_map("3fsk", taken, f3_hz=82e9), "same measured tone"),
        refused(lambda: depth_map("3fsk", taken, f3_hz=81.8e9), "same measured tone"),
        refused(lambda: depth_map("3fsk-plus", taken, f2_hz=82e9 + 1.0), "same measured tone"),
        refused(lambda: depth_map("nfsk", taken, tones_hz=[82e9, 82e9, 79.5e9]), "0 GHz"),
        refused(lambda: depth_map("2fsk", listed, f2_hz=82e9), "same measured tone"),
    ]
    return next((answer for answer in answers if isinstance(answer, Worst)), answers[0])


@case(
    "phase",
    "tones in another order",
    quantity="change of the depth",
    reference="descending tones",
    unit="mm",
    bound=1e-9,
    reason="both signs of φ and Δf turn: what is left is the order of two sums in double precision",
)
def order() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        for id in ("2fsk", "3fsk", "3fsk-plus"):
            for turned, (f1, f2) in product((False, True), permutations((82e9, 81.8e9))):
                tones = np.array(LADDER_HZ)[:: -1 if turned else 1]
                taken = capture(echoes(POINT_M, frequencies_hz=tones), tones)
                there = middle(depth_map(id, taken, f1_hz=f1, f2_hz=f2).z_m)
                usual = middle(_found(id, POINT_M[2]).z_m)
                yield f"{id}, f1 {f1 / 1e9:g} GHz, file {'as' if turned else 'des'}cending", 1e3 * abs(there - usual)

    return worst(seen())


@case(
    "phase",
    "a third tone far away",
    quantity="share of pixels off by half a period without flag",
    reference="the flag's probability",
    unit="1",
    bound=0.1,
    reason="the ambiguity shrinks below the coarse error's 3σ; what then wraps more likely than 0.1 is flagged",
)
def far_tone() -> Worst:
    def seen() -> Iterator[tuple[str, float]]:
        for f3_hz in (79.5e9, 76e9, 72e9, 60e9, 40e9, 20e9):
            tones = np.array([82e9, 81.8e9, f3_hz])
            clean = echoes(bumpy_points(), frequencies_hz=tones)
            values = {"f3_hz": f3_hz, "half_m": 0.02, "first_depth_m": 0.28, "fine_filter_px": 1, "tolerance": None}
            right = depth_map("3fsk", capture(clean, tones), **values).z_m
            half_m, silent = C / (4 * (82e9 - f3_hz)), []
            for seed in range(3):
                found = depth_map("3fsk", capture(noisy(clean, 900.0, 30.0, seed), tones), **values)
                on = np.isfinite(right) & np.isfinite(found.z_m)
                silent.append(((np.abs(found.z_m - right) > half_m) & ~found.wrapped)[on].mean())
            yield f"f3 {f3_hz / 1e9:g} GHz", float(np.mean(silent))

    return worst(seen())


@case(
    "phase",
    "a ladder with a rung too far",
    quantity="depth from a rung that noise cannot reach",
    reference="a refusal",
    unit="mm",
    bound=0.0,
    reason="3σ of a rung must stay within the next one's ambiguity: Δf'/Δf ≤ π/(3·0.03 rad) = 35",
)
def too_far() -> Refused | Worst:
    taken, answer = capture(_point_at(0.28), LADDER_HZ), None
    for last_hz in (74.9e9, 72e9, 40e9, 1e9, 1e6, 1e12):
        tones = [82e9, 81.8e9, last_hz]
        answer = refused(lambda tones=tones: depth_map("nfsk", taken, tones_hz=tones), "rung", "put a tone")
        if isinstance(answer, Worst):
            return answer
    return answer
