"""Every path that computes in single precision against double precision, written apart, or the
closed form.

u = 2⁻²⁴ is the rounding of float32. A sum of n products in it errs by at most n·u of the sum of
their magnitudes, in any order (Higham 2002, sec. 3.1); white noise, whose sum is far smaller than
that, shows the errors best.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.mesh_files import mesh, read_triangles, write_mesh
from handbench.radar.data.arrays import AntennaArray, Aperture, PlanarScan, qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.cpu.exact import path_lengths
from handbench.radar.imaging.cpu.steering import cis_turns
from handbench.radar.imaging.skeleton import AMPLIFICATION, resampler
from handbench.radar.methods.fsk import depth_step_m, masked_mean
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.rays import Rays
from handbench.bench.studies.study import relative_error
from tests.hard_cases.cases import U_SINGLE as U
from tests.hard_cases.cases import U as U_DOUBLE
from tests.hard_cases.scenes import (
    LADDER_HZ,
    POINT_M,
    C,
    capture,
    depth_map,
    echoes,
    small_array,
    white_noise,
)
from tests.hard_cases.test_meshes_cases import on_plane, plane_error_m
from tests.radar.exact import backproject, tone_images

pytestmark = pytest.mark.usefixtures("planned")

STEER = 4 * U  # a steering phase, radians: its remainder rounds to π/2·u, cosine and sine by 2u
PAIR_MM = 1e3 * C / (4 * np.pi * 0.2e9)  # depth per radian between the closest tones
TONES_HZ = np.linspace(72e9, 82e9, 16)
MANY_HZ = np.linspace(72e9, 82e9, 4096)
UNEVEN_HZ = np.sort(np.random.default_rng(7).uniform(72e9, 82e9, 16))
GRID = VoxelGrid(
    np.linspace(-0.01, 0.01, 11), np.linspace(-0.01, 0.01, 11), np.linspace(0.27, 0.29, 21)
)


class Line(NamedTuple):
    """One path: where it uses single precision, the bound of its error, and the error."""

    path: str
    single: str
    bound: float
    measured: float


def waves(points_m: np.ndarray, leg_m: np.ndarray, tone_hz: float) -> np.ndarray:
    """e^{+j2πfR/c} [p, n] from points [p, 3] to antennas [n, 3], in double precision."""
    turns = tone_hz * np.linalg.norm(points_m[:, None] - leg_m, axis=2) / 299_792_458
    return np.exp(2j * np.pi * (turns - np.rint(turns)))


def direct(
    samples: np.ndarray, tones_hz: np.ndarray, array: Aperture, points_m: np.ndarray
) -> np.ndarray:
    """Σ S e^{+j2πf(|p−t|+|p−r|)/c} [p] of samples [f, t, r], or of a scan's [f, n]."""
    total = np.zeros(len(points_m), np.complex128)
    for tone_hz, of_tone in zip(tones_hz, samples.astype(np.complex128), strict=True):
        if isinstance(array, PlanarScan):
            total += waves(points_m, array.position_m, tone_hz) ** 2 @ of_tone
        else:
            home = waves(points_m, array.rx_m, tone_hz) @ of_tone.T
            total += (waves(points_m, array.tx_m, tone_hz) * home).sum(axis=1)
    return total


def of_samples() -> Iterator[Line]:
    path_m = path_lengths(small_array(), np.array(POINT_M))
    exact = np.exp(-2j * np.pi * 82e9 * path_m / C)
    error = float(np.abs(np.angle(exact.astype(np.complex64).astype(np.complex128) / exact)).max())
    yield Line("samples of a capture", "real and imaginary part", U, error)


def of_steering() -> Iterator[Line]:
    for range_m in (0.3, 2.0, 20.0):
        turns = np.random.default_rng(0).uniform(0.5, 1.0, 4000) * 2 * range_m * 82e9 / C
        found = np.array([cis_turns(t) for t in turns])
        phase = 2 * np.pi * np.mod(turns, 1.0)  # exact: the remainder of a float64 is one
        measured = np.abs(found - np.stack([np.cos(phase), np.sin(phase)], axis=1)).max()
        where = "cosine and sine of the remainder of a turn, itself in double"
        yield Line(f"steering at {range_m:g} m", where, STEER, measured)


def of_exact() -> Iterator[Line]:
    points = GRID.points_m().reshape(-1, 3)[::40]
    places_m = np.random.default_rng(2).uniform(-0.07, 0.07, (2, 300))
    scan = PlanarScan(np.stack([*places_m, np.zeros(300)], axis=1))
    few = AntennaArray(small_array().tx_m[:3], small_array().rx_m[:3])
    added = "steering, products, sums over antennas and tones"
    for name, single, array, tones, bound in (
        ("exact points, 94 + 94 antennas", added, qar50(), TONES_HZ[:4], sums(qar50(), 4)),
        (
            "exact points, tones unevenly spaced",
            added,
            small_array(),
            UNEVEN_HZ,
            sums(small_array(), len(UNEVEN_HZ)),
        ),
        ("exact points, 4096 tones", added, few, MANY_HZ, sums(few, len(MANY_HZ))),
        (
            "planar scan",
            "steering; sums over positions in double",
            scan,
            TONES_HZ[:4],
            STEER + 5 * U,
        ),
    ):
        samples = white_noise((len(tones), *array.channels))
        off = np.abs(
            backproject(samples, tones, array, points) - direct(samples, tones, array, points)
        ).max()
        yield Line(name, single, bound, off / np.abs(samples).sum())
    samples = white_noise((len(TONES_HZ), *small_array().channels))
    off = np.abs(
        image_volume(samples, TONES_HZ, small_array(), GRID, None).ravel() - _volume(samples)
    ).max()
    yield Line(
        "exact volume",
        "as exact points",
        sums(small_array(), len(TONES_HZ)),
        off / np.abs(samples).sum(),
    )


def sums(array: Aperture, tones: int) -> float:
    """Most that an exact image errs by, over Σ|S|: steering twice, and sums over 2t, 2r and the
    tones."""
    t, r = (len(leg.position_m) for leg in array.legs)
    return 2 * STEER + (2 * t + 2 * r + tones) * U


def of_fast() -> Iterator[Line]:
    array, points = small_array(), GRID.points_m().reshape(-1, 3)[::7]
    samples = white_noise((len(TONES_HZ), *array.channels))
    exact, at_points = _volume(samples), direct(samples, UNEVEN_HZ, array, points)
    for tolerance in (1e-3, 1e-5):
        found = {
            "volume": (image_volume(samples, TONES_HZ, array, GRID, tolerance).ravel(), exact),
            "projection": (
                project_volume(samples, TONES_HZ, array, GRID, tolerance).magnitude[1],
                np.abs(exact.reshape(GRID.shape)).max(axis=0),
            ),
            "points, tones unevenly spaced": (
                image_points(samples, UNEVEN_HZ, array, points, tolerance),
                at_points,
            ),
        }
        for name, both in found.items():
            single = f"weights, phases within a leaf, products; tolerance {tolerance:g}"
            yield Line(
                f"fast {name}", single, tolerance + fast_floor(len(TONES_HZ)), relative_error(*both)
            )


def fast_floor(tones: int) -> float:
    """The roundings of the fast chain on noise, relative L2: three levels, each a steering and
    products of three sums whose roundings are independent, so that they grow with the root of their
    terms."""
    terms = 2 * sum(small_array().channels) + tones
    return 3 * (2 * STEER + np.sqrt(terms) * U)


def of_forward() -> Iterator[Line]:
    generator, count = np.random.default_rng(3), 300
    position = np.array(POINT_M) + generator.uniform(-0.01, 0.01, (count, 3))
    weight = generator.normal(size=count)
    legs = [
        [waves(position, leg, tone) for tone in TONES_HZ]
        for leg in (small_array().tx_m, small_array().rx_m)
    ]
    exact = np.einsum("fpt,p,fpr->ftr", np.conj(legs[0]), weight, np.conj(legs[1]), optimize=True)
    scatterers = Scatterers(position, weight)
    found = simulate(scatterers, TONES_HZ, small_array(), spreading=False, tolerance=None)
    error = np.abs(found - exact).max() / np.abs(weight).sum()
    yield Line("forward model, exact", "gains, steering, sums", 2 * STEER + (count + 6) * U, error)
    found = simulate(scatterers, TONES_HZ, small_array(), spreading=False, tolerance=1e-5)
    bound = 1e-5 + fast_floor(len(TONES_HZ)) + np.sqrt(count) * U
    yield Line(
        "forward model, fast",
        "as fast volume; tolerance 1e-05",
        bound,
        relative_error(found, exact),
    )


def _volume(samples: np.ndarray) -> np.ndarray:
    """The volume [n] in double precision."""
    return direct(samples, TONES_HZ, small_array(), GRID.points_m().reshape(-1, 3))


def of_resampling() -> Iterator[Line]:
    for tolerance in (1e-3, 1e-5):
        fine = np.linspace(-0.15, 0.15, 601)
        found = resampler(fine, 400.0, 0.6 * tolerance)
        generator = np.random.default_rng(5)
        band, weight = generator.uniform(-400, 400, 50), generator.normal(size=50)
        wave, nodes = (np.cos(np.multiply.outer(at, band)) @ weight for at in (fine, found.nodes_m))
        out = np.empty(len(fine), np.float32)
        found.apply(nodes.astype(np.float32), out)
        count = max((of.stop - of.start for _, of, _ in found.windows), default=1)
        bound = 0.6 * tolerance + AMPLIFICATION * (np.sqrt(count) + 2) * U
        where = f"nodes, weights and sums; tolerance {0.6 * tolerance:g}"
        yield Line("resampling", where, bound, relative_error(out, wave))


def of_fsk() -> Iterator[Line]:
    """Depth steps of a point's pixels from images in single and double precision; maps at the
    default tolerance."""
    samples = echoes(POINT_M, frequencies_hz=LADDER_HZ).astype(np.complex64)
    tones, array = np.array(LADDER_HZ), small_array()
    x, y = np.meshgrid(np.linspace(-0.004, 0.004, 9), np.linspace(-0.004, 0.004, 9))
    points = np.stack([x, y, np.full_like(x, POINT_M[2] + 0.002)], axis=-1).reshape(-1, 3)
    single = tone_images(samples, tones, array, points)
    double = np.array([direct(samples[[i]], tones[[i]], array, points) for i in range(len(tones))])
    seen = np.abs(double[0]) > np.abs(double[0]).max() * 10 ** (-10 / 20)
    total, weakest = np.abs(samples[0]).sum(), np.abs(double[:, seen]).min()
    for name, a, b in (("two tones", 0, 1), ("three tones", 0, 3), ("ladder", 0, 4)):
        difference_hz = tones[a] - tones[b]
        steps_m = [
            depth_step_m(images[a, seen], images[b, seen], difference_hz)
            for images in (single, double)
        ]
        error = 1e3 * np.abs(steps_m[0] - steps_m[1]).max()
        bound = 1e3 * C / (4 * np.pi * difference_hz) * 2 * sums(array, 0) * total / weakest
        yield Line(f"FSK depth, {name}", "images; phases and depths in double", bound, error)
    yield from (_map_line(id) for id in ("2fsk", "3fsk", "nfsk"))


def _map_line(id: str) -> Line:
    """A whole map at the default tolerance against the exact sum. The tolerance bounds the image's
    error as a whole, which at worst lies in one pixel, here one at the threshold."""
    taken, pixels = capture(echoes(POINT_M, frequencies_hz=LADDER_HZ), LADDER_HZ), 25 * 25
    fast, exact = (
        depth_map(id, taken, tolerance=tolerance, first_depth_m=0.28) for tolerance in (1e-5, None)
    )
    both = np.isfinite(fast.z_m) & np.isfinite(exact.z_m)
    error = 1e3 * np.abs(fast.z_m - exact.z_m)[both].max()
    power = 10 ** (exact.amplitude_db.astype(np.float64) / 10)
    spill = np.sqrt(power.mean() * pixels) / 10 ** (-10 / 20)
    bound = PAIR_MM * 2 * (1e-5 + fast_floor(len(LADDER_HZ))) * spill
    return Line(f"{id}, a whole map", "images, fast; tolerance 1e-05", bound, error)


def of_smoothing() -> Iterator[Line]:
    values = 0.3 + 0.01 * np.random.default_rng(4).standard_normal((60, 60))
    padded = np.pad(values.astype(np.longdouble), 2)
    exact = sum(padded[i : i + 60, j : j + 60] for i in range(5) for j in range(5))[2:-2, 2:-2] / 25
    error = 1e3 * float(np.abs(masked_mean(values, 5)[2:-2, 2:-2] - exact).max())
    yield Line("smoothing", "nothing", 1e3 * 20 * U_DOUBLE * np.abs(values).max(), error)


def of_rays() -> Iterator[Line]:
    slope, axis = np.array([0.7, -0.4]), np.linspace(-0.15, 0.15, 61)
    vertices = on_plane(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]), slope)
    faces, places = (
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2),
    )
    error = 1e3 * plane_error_m(depth_on_grid(mesh(vertices, faces), axis, axis), axis, axis, slope)
    bound = 1e3 * 16 * U_DOUBLE * (1 + np.abs(slope).sum())
    single = "which triangle is hit; its depth in double"
    yield Line("ray casting, depth on the grid", single, bound, error)
    origins = np.column_stack([places, np.zeros(len(places))])
    distance, _ = Rays(vertices, faces).first_hits(origins, np.tile([0.0, 0, 1], (len(places), 1)))
    error = 1e3 * float(np.abs(distance - on_plane(places, slope)[:, 2]).max())
    bound = 1e3 * 8 * U * (np.abs(vertices).max() + np.abs(slope).sum() * 0.2)
    yield Line("ray casting, first hits", "rays, vertices, distance", bound, error)


def of_meshes() -> Iterator[Line]:
    generator = np.random.default_rng(6)
    vertices = generator.uniform(-0.3, 0.3, (60, 3))
    faces = np.arange(60).reshape(-1, 3)
    with tempfile.TemporaryDirectory() as folder:
        write_mesh(Path(folder) / "mesh.ply", mesh(vertices, faces))
        stl = np.zeros(
            20, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        )
        stl["corners"] = vertices[faces]
        (Path(folder) / "mesh.stl").write_bytes(
            bytes(80) + (20).to_bytes(4, "little") + stl.tobytes()
        )
        for name, single, bound in (
            ("mesh.ply", "nothing", 0.0),
            ("mesh.stl", "the format itself", 1e3 * 0.3 * U),
        ):
            again, corners, _ = read_triangles(Path(folder) / name)
            error = 1e3 * float(np.abs(again[corners] - vertices[faces]).max())
            yield Line(f"mesh file, {name[-3:].upper()}", single, bound, error)


PATHS = (
    of_samples,
    of_steering,
    of_exact,
    of_fast,
    of_forward,
    of_resampling,
    of_fsk,
    of_smoothing,
    of_rays,
    of_meshes,
)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.__name__)
def test_errors_stay_within_what_roundings_allow(path):
    off = [line for line in path() if not line.measured <= line.bound]
    assert not off
