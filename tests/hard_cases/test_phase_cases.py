"""Hard phases: at and across each pair's ambiguity, pairs of tones too close and too far apart,
first depths that are wrong, points that tie, points at the edge of what is imaged and outside.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product

import numpy as np
from flint import arb

from handbench.radar.data.arrays import qar50
from handbench.radar.data.grid import Axis, PixelGrid
from handbench.radar.imaging.cpu.exact import exact_images
from handbench.radar.methods.backprojection import Backprojection, backprojection
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty, wrap_probability
from handbench.radar.methods.fsk import Fsk, depth_step_m, fsk
from handbench.radar.methods.gross_errors import with_p_gross
from tests.hard_cases.cases import U_SINGLE, Seen, U, Works, hard_case, refusal
from tests.hard_cases.scenes import (
    FSK,
    HALF_M,
    LADDER_HZ,
    PERIOD_M,
    POINT_M,
    STEP_M,
    VOXEL_MM,
    C,
    by_flag,
    capture,
    depth_map,
    echoes,
    flags,
    left_m,
    middle,
    recorded,
)
from tests.references.balls import LIGHT_M_S, PI, balls, off

PAPER_HZ = (82.0e9, 81.8e9, 79.5e9)
CELL_M = 0.006  # resolution cell at 0.3 m
FINEST_HZ = {"2fsk": 0.2e9, "3fsk": 2.3e9, "3fsk-plus": 2.3e9, "nfsk": 9.8e9}
OFFSETS_MM = (-1000, -700, -400, -370, -200, -100, -10, 10, 100, 200, 370, 400, 700, 1000)
NEAREST_M = 0.14  # a first plane as near as the aperture is wide
BESIDE_M = np.hypot(POINT_M[2], HALF_M) - POINT_M[2]  # what a pixel beside the point sees it nearer
PAPER = Fsk()
NEARER_M = [
    POINT_M[2] + off / 1000 for off in OFFSETS_MM if off < 0 and POINT_M[2] + off / 1000 > NEAREST_M
]
Pixels = Iterator[tuple[str, np.ndarray, np.ndarray]]


@hard_case(
    "a step at and across ±c/4Δf",
    kind="rigorous",
    bound=2 * U_SINGLE,
    unit="rad",
    quantity="error of the phase, periods apart",
    reference="4πΔf·Δz/c wrapped, in balls",
)
def test_across() -> Seen:
    """Each image rounds to single precision: 2⁻²⁴ rad at most, of two images 2⁻²³."""
    share = np.array(
        [0, 0.1, 0.3, 0.5, 0.77, 1 - 1e-6, 1 - 2**-24, 1, 1 + 2**-24, 1 + 1e-6, 1.5, 2, 3]
    )
    for difference_hz, sign in product((0.2e9, 0.5e9, 0.7e9, 2.3e9, 2.5e9, 9.8e9, 10e9), (-1, 1)):
        turns = sign * share / 2  # of the phase, from the step −Δz; exact
        image, one = (
            np.exp(2j * np.pi * turns).astype(np.complex64),
            np.ones(len(share), np.complex64),
        )
        found = (
            balls(depth_step_m(image, one, difference_hz)) * 2 * difference_hz / LIGHT_M_S
        )  # turns
        periods = np.rint(found.astype(np.float64) + turns)
        yield (
            f"Δf {difference_hz / 1e9:g} GHz",
            off(0 * turns, (found + turns - periods) * 2 * PI).max(),
        )


@hard_case(
    "the probability of a wrap at the ambiguity",
    kind="rigorous",
    bound=(4 * 0.2239 + 3) * U,  # |dp/dx|·x = x·p(1 − p) ≤ 0.2239
    unit="1",
    quantity="wrap_probability",
    reference="two Gaussian hypotheses, in balls",
)
def test_wraps_at() -> Seen:
    """Four roundings of the exponent x, which turn p by x·p(1 − p) ≤ 0.224 of them, and three
    of p itself, 2⁻⁵³ each."""
    step = np.array([0, 29.9, 30 - 1e-9, 30, 30 + 1e-9, 30.1, 60, 300])
    for sigma in (0.0, 1e-300, 1e-9, 1e-3, 1.0, 30.0, 1e9):
        found = wrap_probability(step, np.full(len(step), sigma), 30.0)
        exponent = 60 * (30 - balls(step)) / arb(sigma or 1e-300) ** 2
        odds = np.exp(-np.abs(exponent))  # of the less likely period; halfway it is either
        exact = np.where(step < 30, odds, 1) / (1 + odds)
        yield f"σ {sigma:g} mm", off(found, exact).max()


@hard_case(
    "the coarse error across ±30 mm",
    kind="derived",
    bound=1e3 * PERIOD_M / 2,
    unit="mm",
    quantity="depth off by half a period without flag",
    reference="two planes a step apart",
)
def test_coarse_error() -> Seen:
    """A filter across the edge is off by up to half the step; beyond 30 mm the third tone adds
    a period, which must be flagged; no pixel without flag is off by more than half of one.
    Pixels a resolution cell from the edge: nearer ones see both planes in one phase."""
    for height_mm in (20, 40, 60, 65, 70, 75, 80, 85, 90, 95, 100, 110):
        far_m = 0.26 + height_mm / 1000
        along = np.arange(-0.027, 0.0271, 0.006)
        x, y = np.meshgrid(along, along)
        points = np.stack([x, y, np.where(x < 0, 0.26, far_m)], axis=-1).reshape(-1, 3)
        taken = recorded(points, PAPER_HZ, qar50())  # a thin array's lobes would meddle
        for size in (15, 31):
            axis = Axis(start_m=-0.024, stop_m=0.024, step_m=STEP_M)
            config = Fsk(x=axis, y=axis, filter_px=size, first_depth_m=0.3)
            depth = fsk_with_uncertainty(taken, config)
            z_m = fsk(taken, config)[1][-1].z_m  # before the last filter
            off_m, beside = (
                np.abs(z_m - np.where(depth.x_m < 0, 0.26, far_m)),
                np.abs(depth.x_m) > CELL_M,
            )
            yield from by_flag(
                f"step {height_mm} mm, filter {size}", off_m[:, beside], flags(depth)[:, beside]
            )


@hard_case(
    "a pair of tones that meet",
    kind="derived",
    bound=2 * (1 + 2 * 4 + 1) * U_SINGLE,  # of each tone's samples, both steerings and image
    unit="rad",
    quantity="error of the depth, over cΔφ/4πΔf of a rounding Δφ",
    reference="the point",
)
def test_tones_meet() -> Seen:
    """Samples and the image round to single precision by 2⁻²⁴, both steerings by 4·2⁻²⁴, at
    each of two tones; the last micrometre is the factor 2's."""
    for difference_hz in (2e8, 2e7, 2e6, 2e5, 2e4, 2e3, 2e2, 20.0):
        tones = np.array([82e9, 82e9 - difference_hz])
        taken = recorded(POINT_M, tones)
        depth = depth_map(
            "2fsk", taken, tones_hz=tones.tolist(), tolerance=None, first_depth_m=0.28
        )
        metres = C / (4 * np.pi * difference_hz)
        yield (
            f"Δf {difference_hz:g} Hz",
            max(abs(float(middle(depth.z_m)) - 0.28) - 1e-6, 0.0) / metres,
        )


@refusal("equal tones")
def test_equal_tones() -> Works:
    """φ/Δf has no value; every pair of a method, and a capture that lists a tone twice, must be
    refused."""
    twice = [82e9, 82e9, 79.5e9]
    for id, measured_hz, values, words in (
        ("2fsk", twice, {"tones_hz": [82e9, 82e9]}, "closest pair first"),
        ("nfsk", LADDER_HZ, {"tones_hz": twice}, "closest pair first"),
        ("3fsk-plus", LADDER_HZ, {"tones_hz": [82e9, 82e9 + 1.0, 79.5e9]}, "same nearest tone"),
        ("3fsk", LADDER_HZ, {"tones_hz": [82e9, 81.8e9, 81.8e9]}, "closest pair first"),
    ):
        yield (
            f"{id}, {values}",
            partial(depth_map, id, recorded(POINT_M, measured_hz), **values),
            words,
        )


def _first_imaged(within: bool, nearest_m: float) -> Pixels:
    """The place, errors [n] and flags [n] of the pixels of a point at 0.28 m and of one at 1.2 m,
    when the first image lies some way off, within ±375 mm or beyond, and further than nearest_m
    away."""
    for id, z_m, offset_mm in product(FSK, (0.28, 1.2), OFFSETS_MM):
        first_m = z_m + offset_mm / 1000
        if first_m > nearest_m and (abs(offset_mm) < 375) == within:
            depth = depth_map(id, recorded((0, 0, z_m), LADDER_HZ), first_depth_m=first_m)
            on = np.isfinite(depth.z_m) | flags(depth)
            place = f"{id}, a point at {z_m:g} m first imaged at {first_m:.3g} m"
            yield place, np.abs(depth.z_m - z_m)[on], flags(depth)[on]


@hard_case(
    "a first depth 10 to 370 mm off, z_e corrected once",
    kind="derived",
    # From nearer planes both errors are nearer; from behind they are of opposite signs.
    bound=1e3 * (BESIDE_M + max(left_m(POINT_M, first_m) for first_m in NEARER_M)),
    unit="mm",
    quantity="error on target",
    reference="the point",
)
def test_first_depth() -> Seen:
    """From planes no nearer than the aperture is wide, 0.14 m, one correction leaves 6 % of
    itself, for the factor 2 of the path's derivative, and the pixel's own step 4 % of that,
    0.24 mm; a pixel 12 mm beside the point sees its range, 0.26 mm nearer."""
    return ((place, 1e3 * error.max()) for place, error, _ in _first_imaged(True, NEAREST_M))


@hard_case(
    "a first depth 400 mm to 1 m off",
    kind="measured",
    bound=0.1,
    unit="1",
    quantity="share of pixels wrong without flag",
    reference="no pixel",
)
def test_first_depth_beyond() -> Seen:
    """The pair settles 750 mm off, 12.5 periods of the third tone, whose step is then half a
    period: likelier wrapped than wrap_probability, 0.1, at nine pixels of ten. Two tones tell
    depths 750 mm apart by their focus alone: those of wrong periods are flagged where a plane a
    period away is sharper, and those behind the array."""
    return (
        (place, float(np.mean((error > 0.005) & ~wrapped)))
        for place, error, wrapped in _first_imaged(False, 0.02)
    )


@hard_case(
    "two equal maxima",
    kind="derived",
    bound=1.0,
    unit="1",
    quantity="error at the brighter point, over what the other's leak allows",
    reference="the points",
)
def test_two_maxima() -> Seen:
    """z_e settles on one of the two, whichever rounding prefers, and that one must be right: a
    leak of the other, a share s of its amplitude, turns each image by s at most: cs/(2πΔf), and
    twice what the factor 2 leaves, 0.37 mm."""
    array = qar50()
    along = np.arange(-0.024, 0.0241, STEP_M)
    first = PixelGrid(along, along).points_m(0.45).reshape(-1, 3)
    for apart_mm in (0, 10, 60, 160):
        points = np.array([[-0.02, 0, 0.28], [0.02, 0, 0.28 + apart_mm / 1000]])
        alone = [echoes(point, None, LADDER_HZ, array).astype(np.complex64) for point in points]
        peaks = [np.abs(_images(samples, first)[:2]).mean(axis=0).max() for samples in alone]
        at = [np.abs(_images(samples, points)).max(axis=0) for samples in alone]  # [echo][point]
        for more in (0.9, 0.95, 0.99, 1 - 1e-6, 1, 1 + 1e-6, 1.01, 1.1):
            weight = np.array([more, 1 / more]) / peaks
            taken = capture(
                sum(w * samples for w, samples in zip(weight, alone, strict=True)), LADDER_HZ, array
            )
            for id in FSK:
                depth = depth_map(id, taken, half_m=0.024)
                row, columns = depth.z_m.shape[0] // 2, np.array([4, -5])
                one = int(depth.amplitude_db[row, columns].argmax())
                leak = weight[1 - one] * at[1 - one][one] / (weight[one] * at[one][one])
                allowed_m = C * leak / (2 * np.pi * FINEST_HZ[id]) + 2 * left_m(
                    points[one], PAPER.first_depth_m
                )
                error_m = abs(float(depth.z_m[row, columns[one]]) - points[one, 2])
                yield f"{id}, {apart_mm} mm apart, strengths {more:g}", error_m / allowed_m


def _images(samples: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    return exact_images(samples, np.array(LADDER_HZ), qar50(), points_m, per_tone=True)


@hard_case(
    "a point outside the image",
    kind="derived",
    bound=1e3 * PERIOD_M / 2,
    unit="mm",
    quantity="depths on the map, off by half a period without flag",
    reference="the sphere of the point's range",
)
def test_outside() -> Seen:
    """The pixels inside see the point's sidelobe, whose range is the point's own within a cell:
    no period off."""
    for id, beside_mm in product(FSK, (13, 15, 20, 30, 50, 80)):
        point = np.array([beside_mm / 1000, 0.0, 0.28])
        depth = depth_map(id, recorded(point, LADDER_HZ))
        x, y = np.meshgrid(depth.x_m, depth.y_m)
        off_m = np.abs(np.sqrt(depth.z_m**2 + x**2 + y**2) - np.linalg.norm(point))
        yield from by_flag(f"{id}, {beside_mm} mm beside", off_m, flags(depth))


@hard_case(
    "a point before and behind the projection's box",
    kind="derived",
    bound=VOXEL_MM + 1e3 * 4 * U * 0.325,
    unit="mm",
    quantity="error on target without flag",
    reference="the point",
)
def test_outside_the_box() -> Seen:
    """Within the box half a voxel; outside it the strongest voxel is the box's last, or a range
    sidelobe whose tones do not agree: neither may pass for a depth."""
    axis = Axis(start_m=-HALF_M, stop_m=HALF_M, step_m=STEP_M)
    config = Backprojection(x=axis, y=axis)
    for z_m in (0.245, 0.2454, 0.28, 0.3246, 0.325, 0.326, 0.335, 0.35, 0.2, 0.6):
        taken = recorded((0, 0, z_m))
        depth = with_p_gross(backprojection(taken, config), taken, config)
        off_mm = 1e3 * abs(float(middle(depth.z_m)) - z_m)
        doubted = middle(flags(depth)) or middle(depth.p_gross) > 0.5
        yield f"a point at {z_m:g} m", off_mm, bool(doubted)
