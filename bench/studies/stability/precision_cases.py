"""The error budget of single precision: every path that uses it; here its errors in depths, grids and files, against
double precision or the closed form.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.results.stability import Table
from bench.studies.stability import precision_images as images
from bench.studies.stability.precision_images import PAIR_MM, Line, U, fast_floor, image_line, relative, sums
from bench.studies.stability.scenes import LADDER_HZ, POINT_M, C, capture, depth_map, echoes, small_array
from radar.imaging.cpu.exact import direct_sum, tone_images
from radar.imaging.skeleton import AMPLIFICATION, resampler
from radar.methods.fsk import depth_step_m
from radar.methods.smoothing import masked_mean

U_DOUBLE = 2.0**-53


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
        yield image_line("resampling", where, bound, relative(out, wave))


def of_fsk() -> Iterator[Line]:
    """Depth steps of a point's pixels from images in single and double precision; maps at the default tolerance."""
    samples = echoes(POINT_M, frequencies_hz=LADDER_HZ).astype(np.complex64)
    tones, array = np.array(LADDER_HZ), small_array()
    x, y = np.meshgrid(np.linspace(-0.004, 0.004, 9), np.linspace(-0.004, 0.004, 9))
    points = np.stack([x, y, np.full_like(x, POINT_M[2] + 0.002)], axis=-1).reshape(-1, 3)
    single = tone_images(samples, tones, array, points)
    double = np.array([direct_sum(samples[[i]], tones[[i]], array, points) for i in range(len(tones))])
    seen = np.abs(double[0]) > np.abs(double[0]).max() * 10 ** (-10 / 20)
    total, weakest = np.abs(samples[0]).sum(), np.abs(double[:, seen]).min()
    for name, a, b in (("two tones", 0, 1), ("three tones", 0, 3), ("ladder", 0, 4)):
        difference_hz = tones[a] - tones[b]
        steps_m = [depth_step_m(images[a, seen], images[b, seen], difference_hz) for images in (single, double)]
        error = 1e3 * np.abs(steps_m[0] - steps_m[1]).max()
        bound = 1e3 * C / (4 * np.pi * difference_hz) * 2 * sums(array, 0) * total / weakest
        yield Line(f"FSK depth, {name}", "images; phases and depths in double", bound, error, "mm", error)
    yield from (_map_line(id) for id in ("2fsk", "3fsk", "nfsk"))


def _map_line(id: str) -> Line:
    """A whole map at the default tolerance against the exact sum. The tolerance bounds the image's error as a whole,
    which at worst lies in one pixel, here one at the threshold."""
    taken, pixels = capture(echoes(POINT_M, frequencies_hz=LADDER_HZ), LADDER_HZ), 25 * 25
    fast, exact = (depth_map(id, taken, tolerance=tolerance, first_depth_m=0.28) for tolerance in (1e-5, None))
    both = np.isfinite(fast.z_m) & np.isfinite(exact.z_m)
    error = 1e3 * np.abs(fast.z_m - exact.z_m)[both].max()
    power = 10 ** (exact.amplitude_db.astype(np.float64) / 10)
    spill = np.sqrt(power.mean() * pixels) / 10 ** (-10 / 20)
    bound = PAIR_MM * 2 * (1e-5 + fast_floor(len(LADDER_HZ))) * spill
    return Line(f"{id}, a whole map", "images, fast; tolerance 1e-05", bound, error, "mm", error)


def of_smoothing() -> Iterator[Line]:
    values = 0.3 + 0.01 * np.random.default_rng(4).standard_normal((60, 60))
    padded = np.pad(values.astype(np.longdouble), 2)
    exact = sum(padded[i : i + 60, j : j + 60] for i in range(5) for j in range(5))[2:-2, 2:-2] / 25
    error = 1e3 * float(np.abs(masked_mean(values, 5)[2:-2, 2:-2] - exact).max())
    yield Line("smoothing", "nothing", 1e3 * 20 * U_DOUBLE * np.abs(values).max(), error, "mm", error)


def of_rays() -> Iterator[Line]:
    from groundtruth.mesh.depth import depth_on_grid
    from groundtruth.mesh.mesh_files import mesh
    from radar.support.rays import Rays

    slope, z_m = np.array([0.7, -0.4]), 0.3
    corners = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])
    vertices = np.column_stack([corners, z_m + corners @ slope])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    axis = np.linspace(-0.15, 0.15, 61)
    x, y = np.meshgrid(axis, axis)
    exact = z_m + slope[0] * x + slope[1] * y
    error = 1e3 * float(np.abs(depth_on_grid(mesh(vertices, faces), axis, axis) - exact).max())
    bound = 1e3 * 16 * U_DOUBLE * (1 + np.abs(slope).sum())
    single = "which triangle is hit; its depth in double"
    yield Line("ray casting, depth on the grid", single, bound, error, "mm", error)
    origins, along = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), np.tile([0.0, 0, 1], (x.size, 1))
    distance, _ = Rays(vertices, faces).first_hits(origins, along)
    error = 1e3 * float(np.abs(distance - exact.ravel()).max())
    bound = 1e3 * 8 * U * (np.abs(vertices).max() + np.abs(slope).sum() * 0.2)
    yield Line("ray casting, first hits", "rays, vertices, distance", bound, error, "mm", error)


def of_meshes() -> Iterator[Line]:
    from groundtruth.mesh.mesh_files import mesh, read_triangles, write_mesh

    generator = np.random.default_rng(6)
    vertices = generator.uniform(-0.3, 0.3, (60, 3))
    faces = np.arange(60).reshape(-1, 3)
    with tempfile.TemporaryDirectory() as folder:
        write_mesh(Path(folder) / "mesh.ply", mesh(vertices, faces))
        stl = np.zeros(20, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
        stl["corners"] = vertices[faces]
        (Path(folder) / "mesh.stl").write_bytes(bytes(80) + (20).to_bytes(4, "little") + stl.tobytes())
        for name, single, bound in (("mesh.ply", "nothing", 0.0), ("mesh.stl", "the format itself", 1e3 * 0.3 * U)):
            again, corners, _ = read_triangles(Path(folder) / name)
            error = 1e3 * float(np.abs(again[corners] - vertices[faces]).max())
            yield Line(f"mesh file, {name[-3:].upper()}", single, bound, error, "mm", error)


IMAGES = (images.of_samples, images.of_steering, images.of_exact, images.of_fast, images.of_scan, images.of_forward)
PATHS = (*IMAGES, of_resampling, of_fsk, of_smoothing, of_rays, of_meshes)


def table() -> Table:
    """The budget. Phases become depths by the closest pair of tones, 119 mm/rad, which forgives least."""
    return Table(
        title="Single precision",
        text="error of every path that uses it against double precision, with the bound that roundings allow",
        columns=("path", "single precision in", "bound", "measured", "unit", "depth, mm", "within"),
        rows=tuple((*line, "yes" if line.measured <= line.bound else "no") for path in PATHS for line in path()),
    )
