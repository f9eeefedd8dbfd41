"""Amplification of each estimator's input error, measured by perturbation, beside what theory
expects.

A perturbation is small against what bends the estimator and large against rounding; it goes through
the product, while theory is a formula that is written here.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.metrics import pool, precision
from handbench.calibration.spheres.ball_fit import fit_balls
from handbench.calibration.spheres.description import default_target
from handbench.calibration.spheres.optical_detection import OrientedPoints, fit_sphere
from handbench.calibration.spheres.radar_detection import DetectedBall
from handbench.calibration.transforms import condition_number, umeyama
from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.mesh_files import mesh
from handbench.groundtruth.sparse.frame import triangulate
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.projection import peak_offset
from handbench.radar.simulation.physics.spheres import sphere_echo
from tests.bench.studies.stability.amplifications_of_fsk import (
    ARRAY,
    METHODS,
    amplification,
    expected,
)
from tests.hard_cases.test_registration_cases import PLACE_M, RADIUS_M, outward


class Row(NamedTuple):
    """One estimator's amplification; unit: of its output over its input's."""

    estimator: str
    input: str
    measured: float
    theory: float
    unit: str


def amplifications() -> Iterator[Row]:
    """Estimator by estimator."""
    for method in METHODS:
        measured, theory = amplification(method), expected(method)
        yield Row(f"{method.name} depth", "phase of the last tone", measured, theory, "m/rad")
    for step_m in (1e-3, 2e-3):
        name = f"subvoxel depth, voxels of {1e3 * step_m:g} mm"
        yield Row(name, "relative amplitude of a neighbour", *_subvoxel(step_m), "m")
    # The worst pattern for the centre is as the height without what a radius explains: √3/part for
    # even points, whose heights deviate by 2·part/√12.
    for part in (0.45, 0.15, 0.1):
        name, shift = (
            f"centre of a {part:.0%} cap, free radius",
            _cap_fit(part, lambda h: h - h.mean())[0],
        )
        yield Row(name, "points' rms along the normal", shift, np.sqrt(3) / part, "m/m")
    yield Row("radius of a 15% cap", "points' rms along the normal", *_cap_radius(0.15), "m/m")
    yield Row("ball in the echoes", "delay of all channels, one way", *_ball(), "m/m")
    yield from _rotation()
    for degrees in (20, 60, 80):
        tilt_rad = np.deg2rad(degrees)
        found = plane_depth(tilt_rad), 1 / np.cos(tilt_rad)
        yield Row(
            f"depth of a plane tilted by {degrees}°", "surface along its normal", *found, "m/m"
        )
    for base_m in (0.2, 0.02):
        yield Row(
            f"triangulated point, 0.6 m away, base {base_m:g} m",
            "disparity",
            *triangulated(base_m, 0.6),
            "m/px",
        )
    yield Row("precision of 10 repeats", "repeats, their rms", *_precision(10), "m/m")
    yield Row("MAE", "errors, each further out", *_mae(), "m/m")


def change(of: Callable[[float], Any], step: float) -> Any:
    """The derivative at 0 of a number or an array, by central differences."""
    return (of(step) - of(-step)) / (2 * step)


def _subvoxel(step_m: float) -> tuple[float, float]:
    """Change of the vertex with one neighbour's relative amplitude: of a main lobe sinc(2Bz/c),
    whose logarithm bends by π²/3 per resolution cell squared, 3ρ²/(2π²·step) with ρ = c/2B."""
    cell_m = SPEED_OF_LIGHT_M_S / (2 * 10e9)
    lobe = np.sinc(np.array([-1.0, 0.0, 1.0]) * step_m / cell_m)
    moved = change(lambda more: float(peak_offset(lobe * [1 + more, 1, 1])), 1e-4)
    return abs(moved) * step_m, 3 * cell_m**2 / (2 * np.pi**2 * step_m)


def _cap_fit(
    part: float, along: Callable[[np.ndarray], np.ndarray], size_m: float = 1e-6
) -> tuple[float, float]:
    """Shift of the centre, and growth of the radius, per metre of the points' rms, when they err by
    `along` of their cosine to the axis; the radius is free."""
    n = 4000  # even in height, hence on the sphere
    height = 1 - 2 * part * (np.arange(n) + 0.5) / n
    azimuth = np.pi * (1 + np.sqrt(5)) * np.arange(n)
    normals, error = outward(height, azimuth), along(height)
    points_m = (RADIUS_M + size_m * error / np.sqrt(np.mean(error**2)))[:, None] * normals
    found = fit_sphere(
        OrientedPoints(points_m, normals, oriented=True),
        np.zeros(3),
        RADIUS_M,
        (0,),
        radius_sigma_m=1.0,
    )
    assert found is not None
    return float(np.linalg.norm(found.centre_m)) / size_m, abs(found.radius_m - RADIUS_M) / size_m


def _cap_radius(part: float) -> tuple[float, float]:
    """The worst pattern for the radius: a constant without what the centre's height explains."""

    def constant(height: np.ndarray) -> np.ndarray:
        return 1 - height * height.mean() / np.mean(height**2)

    mean, square = (
        1 - part,
        1 - 2 * part + 4 * part**2 / 3,
    )  # of heights that are even from 1 − 2·part to 1
    return _cap_fit(part, constant)[1], float(1 / np.sqrt(1 - mean**2 / square))


def _ball() -> tuple[float, float]:
    """Shift of a fitted ball with a delay that all channels share, and that of least squares on the
    phases of a point, whose place and strength's phase are free: 2 over the path's rise, or nearly
    so."""
    target, tones_hz = default_target(), np.linspace(72e9, 82e9, 16)
    samples = sphere_echo(
        PLACE_M, target.element[0].ball_radius_m, target.foam_delay_m[0], tones_hz, ARRAY
    )

    def centre_m(late_m: float) -> np.ndarray:
        late = np.exp(-2j * np.pi * tones_hz / SPEED_OF_LIGHT_M_S * 2 * late_m)
        taken = RadarCapture(
            (samples * late[:, None, None])[None].astype(np.complex64), tones_hz, ARRAY
        )
        return fit_balls(taken, target, {0: DetectedBall(PLACE_M, np.eye(3), (0,), PLACE_M, 0.0)})[
            0
        ].centre_m

    to, back = (PLACE_M - leg for leg in (ARRAY.tx_m, ARRAY.rx_m))
    to, back = (leg / np.linalg.norm(leg, axis=1)[:, None] for leg in (to, back))
    gradient = (to[:, None] + back[None]).reshape(-1, 3)
    k = 2 * np.pi * tones_hz / SPEED_OF_LIGHT_M_S
    places = np.multiply.outer(k, gradient).reshape(-1, 3)
    design = np.concatenate([places, np.ones((len(places), 1))], axis=1)
    expected = np.linalg.lstsq(design, np.repeat(2 * k, len(gradient)))[0][:3]
    return float(np.linalg.norm(centre_m(1e-4) - centre_m(-1e-4)) / 2 / 1e-4), float(
        np.linalg.norm(expected)
    )


def _rotation() -> Iterator[Row]:
    """Umeyama's rotation, about its worst axis and of the worst to the best: the singular values of
    how it turns with each coordinate of each point. About axis i it is held by Σ(y² + z²) of the
    centred points in their own axes."""
    points_m = default_target().centres_m * [1, 0.3, 1]  # a narrow target

    def turned(way: np.ndarray, by_m: float) -> np.ndarray:
        return Rotation.from_matrix(umeyama(points_m, points_m + by_m * way)[:3, :3]).as_rotvec()

    ways = np.eye(points_m.size).reshape(-1, *points_m.shape)  # each coordinate of each point
    found = np.linalg.svd([change(partial(turned, way), 1e-7) for way in ways], compute_uv=False)
    squares_m2 = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False) ** 2
    held_m2 = squares_m2.sum() - squares_m2
    name = "rotation of a narrow target"
    yield Row(
        f"{name}, worst axis", "centres, their norm", found[0], held_m2.min() ** -0.5, "rad/m"
    )
    yield Row(
        f"{name}, worst to best axis",
        "centres",
        found[0] / found[2],
        condition_number(points_m, points_m),
        "1",
    )


def _precision(repeats: int) -> tuple[float, float]:
    """Change with depths that move apart, per metre of their rms: √(n/(n − 1))."""
    z_m = 0.3 + 1e-3 * np.random.default_rng(0).standard_normal(repeats)
    way = (z_m - z_m.mean()) / z_m.std()
    found = change(lambda by_m: 1e-3 * precision([z_m + by_m * way])["precision_mm"], 1e-6)
    return found, float(np.sqrt(repeats / (repeats - 1)))


def _mae() -> tuple[float, float]:
    """Change with errors that all grow by as much: 1, the most that it can be."""
    error_m = 1e-3 * np.random.default_rng(0).standard_normal((40, 40))
    axis_m, surface = 1e-3 * np.arange(40), np.full((40, 40), 0.3)

    def mae_m(by_m: float) -> float:
        return (
            1e-3
            * pool([ErrorMap(axis_m, axis_m, error_m + by_m * np.sign(error_m), surface)])["mae_mm"]
        )

    return change(mae_m, 1e-8), 1.0


FOCAL_PX = 1000.0


def plane_depth(tilt_rad: float, step_m: float = 1e-4) -> float:
    """Change of a tilted plane's depth on a grid when it moves along its normal."""
    sine, cosine = np.sin(tilt_rad), np.cos(tilt_rad)
    along, normal = np.array([cosine, 0.0, sine]), np.array([-sine, 0.0, cosine])
    square = np.array(
        [a * along + b * np.array([0.0, 1.0, 0.0]) for a in (-0.1, 0.1) for b in (-0.1, 0.1)]
    )
    faces = np.array([[0, 1, 2], [2, 1, 3]])
    near_m = 0.5e-2 * np.arange(-1, 2) * cosine  # a few pixels about the middle

    def depth_m(by_m: float) -> np.ndarray:
        return depth_on_grid(mesh(square + [0, 0, 0.3] + by_m * normal, faces), near_m, near_m)

    return float(np.nanmax(np.abs(change(depth_m, step_m))))


def triangulated(base_m: float, depth_m: float) -> tuple[float, float]:
    """Change of a point's depth per pixel of disparity between two parallel cameras, and
    z²/(f·b)."""
    colmap = load_pycolmap()
    camera = colmap.Camera(
        camera_id=1,
        model="PINHOLE",
        width=2000,
        height=2000,
        params=[FOCAL_PX, FOCAL_PX, 1000, 1000],
    )
    model, point_m = colmap.Reconstruction(), np.array([0.0, 0.0, depth_m])
    model.add_camera_with_trivial_rig(camera)
    for n, x_m in enumerate((-base_m / 2, base_m / 2)):
        pose = colmap.Rigid3d(colmap.Rotation3d(np.eye(3)), np.array([-x_m, 0, 0]))
        model.add_image_with_trivial_frame(
            colmap.Image(name=f"{n}.png", camera_id=1, image_id=n + 1), pose
        )
    images = [model.images[n + 1] for n in range(2)]
    pixels = [
        np.asarray(camera.img_from_cam((image.cam_from_world() * point_m)[None]))[0]
        for image in images
    ]

    def found_m(by_px: float) -> float:
        apart = (pixels[0] + [by_px / 2, 0], pixels[1] - [by_px / 2, 0])
        point = triangulate(list(zip(apart, images, strict=True)))
        assert point is not None
        return float(point[2])

    return abs(change(found_m, 1e-3)), depth_m**2 / (FOCAL_PX * base_m)
