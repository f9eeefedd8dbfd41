"""Hard phases: at and across each pair's ambiguity, pairs of tones too close and too far apart."""

from __future__ import annotations

from functools import partial
from itertools import permutations, product

import numpy as np

import bench.studies.stability.phase_targets  # noqa: F401  the other half of the group
from bench.studies.stability.cases import Seen, Works, case, refusal
from bench.studies.stability.scenes import (
    LADDER_HZ,
    PERIOD_M,
    POINT_M,
    C,
    bumpy_points,
    by_flag,
    capture,
    depth_map,
    echoes,
    middle,
    noisy,
    recorded,
)
from radar.data.arrays import qar50
from radar.methods.confidence import wrap_probability
from radar.methods.fsk import depth_step_m

PAPER_HZ = (82.0e9, 81.8e9, 79.5e9)
CELL_M = 0.006  # resolution cell at 0.3 m


@case("phase", "a step at and across ±c/4Δf", "rad", 2.0**-23)
def across() -> Seen:
    """Error of the phase, periods apart. Against: 4πΔf·Δz/c wrapped, in long double. Because: each image rounds to
    single precision: 2⁻²⁴ rad at most, of two images 2⁻²³."""
    share = np.array([0, 0.1, 0.3, 0.5, 0.77, 1 - 1e-6, 1 - 2**-24, 1, 1 + 2**-24, 1 + 1e-6, 1.5, 2, 3])
    for difference_hz, sign in product((0.2e9, 0.5e9, 0.7e9, 2.3e9, 2.5e9, 9.8e9, 10e9), (-1, 1)):
        turns = np.longdouble(sign) * share.astype(np.longdouble) / 2  # of the phase, from the step −Δz
        phase = 2 * np.pi * (turns - np.rint(turns)).astype(np.float64)
        image, one = np.exp(1j * phase).astype(np.complex64), np.ones(len(share), np.complex64)
        step_m = depth_step_m(image, one, difference_hz)
        off = step_m * 4 * np.pi * difference_hz / C + phase
        yield f"Δf {difference_hz / 1e9:g} GHz", float(np.abs(off - 2 * np.pi * np.rint(off / 2 / np.pi)).max())


@case("phase", "the probability of a wrap at the ambiguity", "1", 1e-12)
def wraps_at() -> Seen:
    """wrap_probability. Against: two Gaussian hypotheses, in long double. Because: its exponent 2a(a − |Δz|)/σ² rounds
    by a few 2⁻⁵³ of up to 700, beyond which the answer is 0 or 1 itself."""
    step = np.array([0, 29.9, 30 - 1e-9, 30, 30 + 1e-9, 30.1, 60, 300])
    for sigma in (0.0, 1e-300, 1e-9, 1e-3, 1.0, 30.0, 1e9):
        found = wrap_probability(step, np.full(len(step), sigma), 30.0)
        with np.errstate(all="ignore"):
            exponent = 60 * (30 - step.astype(np.longdouble)) / np.longdouble(sigma) ** 2
            exact = 1 / (1 + np.exp(exponent))
        exact = np.where(step == 30, 0.5, exact)  # halfway: either period, however well the point is known
        yield f"σ {sigma:g} mm", float(np.abs(found - exact).max())


@case("phase", "the coarse error across ±30 mm", "mm", 1e3 * PERIOD_M / 2)
def coarse_error() -> Seen:
    """Depth off by half a period without flag. Against: two planes a step apart. Because: a filter across the edge is
    off by up to half the step; beyond 30 mm the third tone adds a period, which must be flagged; no pixel without flag
    is off by more than half of one. Pixels a resolution cell from the edge: nearer ones see both planes in one
    phase."""
    for height_mm in (20, 40, 60, 65, 70, 75, 80, 85, 90, 95, 100, 110):
        far_m = 0.26 + height_mm / 1000
        along = np.arange(-0.027, 0.0271, 0.006)
        x, y = np.meshgrid(along, along)
        points = np.stack([x, y, np.where(x < 0, 0.26, far_m)], axis=-1).reshape(-1, 3)
        taken = recorded(points, PAPER_HZ, qar50())  # a thin array's lobes would meddle
        for size in (15, 31):
            values = {"coarse_filter_px": size, "fine_filter_px": 1, "first_depth_m": 0.3}
            depth = depth_map("3fsk", taken, half_m=0.024, **values)
            off_m, beside = np.abs(depth.z_m - np.where(depth.x_m < 0, 0.26, far_m)), np.abs(depth.x_m) > CELL_M
            yield from by_flag(f"step {height_mm} mm, filter {size}", off_m[:, beside], depth.wrapped[:, beside])


@case("phase", "wrapped pixels are dropped", "pixels", 0.0)
def dropped() -> Seen:
    """Flagged pixels that keep a depth. Against: none. Because: drop_wrapped takes the depth of every flagged pixel,
    before the filter could spread it."""
    clean = echoes(bumpy_points(), frequencies_hz=LADDER_HZ)
    for snr_db, seed in product((40, 25, 15, 5), range(3)):
        taken = capture(noisy(clean, 900.0, snr_db, seed), LADDER_HZ)
        depth = depth_map("3fsk-plus", taken, half_m=0.02, first_depth_m=0.28, tolerance=None)
        yield f"{snr_db} dB, draw {seed}", float(np.count_nonzero(np.isfinite(depth.z_m) & depth.wrapped))


@case("phase", "a pair of tones that meet", "rad", 2.0**-20)
def tones_meet() -> Seen:
    """Error of the depth, over cΔφ/4πΔf of a rounding Δφ. Against: the point. Because: samples, both steerings and the
    image round to single precision, 2⁻²³ rad each and tone, 8 in all; the last micrometre is the factor 2's."""
    for difference_hz in (2e8, 2e7, 2e6, 2e5, 2e4, 2e3, 2e2, 20.0):
        tones = np.array([82e9, 82e9 - difference_hz])
        taken = recorded(POINT_M, tones)
        depth = depth_map("2fsk", taken, f1_hz=tones[0], f2_hz=tones[1], tolerance=None, first_depth_m=0.28)
        metres = C / (4 * np.pi * difference_hz)
        yield f"Δf {difference_hz:g} Hz", max(abs(float(middle(depth.z_m)) - 0.28) - 1e-6, 0.0) / metres


@refusal("phase", "equal tones", unit="mm")
def equal_tones() -> Works:
    """Depth from Δf = 0. Against: a refusal. Because: φ/Δf has no value; every pair of a method, and a capture that
    lists a tone twice, must be refused."""
    twice = [82e9, 82e9, 79.5e9]
    for id, measured_hz, values, words in (
        ("2fsk", twice, {"f2_hz": 82e9}, "same measured tone"),
        ("nfsk", LADDER_HZ, {"tones_hz": twice}, "0 GHz"),
        ("3fsk-plus", LADDER_HZ, {"f2_hz": 82e9 + 1.0}, "same measured tone"),
        ("3fsk", LADDER_HZ, {"f3_hz": 81.8e9}, "same measured tone"),
        ("3fsk", LADDER_HZ, {"f3_hz": 82e9}, "same measured tone"),
        ("2fsk", LADDER_HZ, {"f2_hz": 82e9}, "same measured tone"),
    ):
        yield f"{id}, {values}", partial(depth_map, id, recorded(POINT_M, measured_hz), **values), words


@case("phase", "tones in another order", "mm", 1e-9)
def order() -> Seen:
    """Change of the depth. Against: descending tones. Because: both signs of φ and Δf turn: what is left is the order
    of two sums in double precision."""
    for id in ("2fsk", "3fsk", "3fsk-plus"):
        for turned, (f1, f2) in product((False, True), permutations((82e9, 81.8e9))):
            tones = np.array(LADDER_HZ)[:: -1 if turned else 1]
            there = middle(depth_map(id, recorded(POINT_M, tones), f1_hz=f1, f2_hz=f2).z_m)
            usual = middle(depth_map(id, recorded(POINT_M, LADDER_HZ)).z_m)
            yield f"{id}, f1 {f1 / 1e9:g} GHz, file {'as' if turned else 'des'}cending", 1e3 * abs(there - usual)


@case("phase", "a third tone far away", "1", 0.1)
def far_tone() -> Seen:
    """Share of pixels off by half a period without flag. Against: the flag's probability. Because: the ambiguity
    shrinks below the coarse error's 3σ; what then wraps more likely than 0.1 is flagged."""
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


@refusal("phase", "a ladder with a rung too far", "rung", "put a tone", unit="mm")
def too_far() -> Works:
    """Depth from a rung that noise cannot reach. Against: a refusal. Because: 3σ of a rung must stay within the next
    one's ambiguity: Δf'/Δf ≤ π/(3·0.03 rad) = 35."""
    taken = recorded(POINT_M, LADDER_HZ)
    for last_hz in (74.9e9, 72e9, 40e9, 1e9, 1e6, 1e12):
        yield f"{last_hz / 1e9:g} GHz", partial(depth_map, "nfsk", taken, tones_hz=[82e9, 81.8e9, last_hz])
