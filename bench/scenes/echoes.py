"""The radar half of a scene: physical optics over the surface that the array's centre sees."""

from __future__ import annotations

import numpy as np

from bench.scenes.scene import Scene
from calibration.meshes import load_open3d, raycasting_scene
from radar.arrays import AntennaArray, load_positions, qar50
from radar.capture import RadarCapture
from radar.effects.noise import strongest_amplitude, thermal_noise
from radar.forward import Scatterers, simulate

SHADOW_BIAS_M = 2e-4  # a facet does not shadow itself
BALL_POINTS = 3000  # per calibration ball of a few millimetres: about 0.15 mm apart
PEAK_POINTS = 20_000  # surface points on which the strongest pixel is looked for


def echoes(scene: Scene, frames: int = 1) -> RadarCapture:
    """The scene's echoes; the frames differ in their noise alone, which comes from (scene seed, frame)."""
    array = _array(scene.file.sensor.array)
    frequencies_hz = np.unique(scene.file.sensor.frequencies_hz)
    scatterers = _balls(scene) if scene.target is not None else visible_surface(scene)
    clean = simulate(scatterers, frequencies_hz, array)
    phase_noise_rad = scene.file.noise.phase_noise_rad
    if phase_noise_rad == 0:
        return RadarCapture(np.repeat(clean[None], frames, axis=0), frequencies_hz, array)
    surface_m = scatterers.position_m[:: max(1, len(scatterers.position_m) // PEAK_POINTS)]
    strongest = strongest_amplitude(clean[-1], frequencies_hz[-1], array, surface_m)
    seeds = (np.random.SeedSequence([scene.file.seed, frame]) for frame in range(frames))
    noisy = np.stack([thermal_noise(clean, phase_noise_rad, strongest, seed) for seed in seeds])
    return RadarCapture(noisy, frequencies_hz, array)


def visible_surface(scene: Scene) -> Scatterers:
    """Facets of the target (each split in four) that face the aperture's centre and are not in another's shadow."""
    surface = load_open3d().geometry.TriangleMesh(scene.target_mesh)
    surface.compute_vertex_normals()
    surface = surface.subdivide_midpoint(1)
    vertices, faces = np.asarray(surface.vertices), np.asarray(surface.triangles)
    centroid = vertices[faces].mean(axis=1)
    normal = np.asarray(surface.vertex_normals)[faces].mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    seen = ((normal * centroid).sum(axis=1) < 0) & _in_sight(scene, centroid)
    return Scatterers(centroid[seen], area[seen], normal[seen])


def _in_sight(scene: Scene, points_m: np.ndarray) -> np.ndarray:
    """Whether each point [n, 3] is seen from the aperture's centre: bool [n]."""
    o3d = load_open3d()
    distance = np.linalg.norm(points_m, axis=1, keepdims=True)
    rays = np.hstack([np.zeros_like(points_m), points_m / distance]).astype(np.float32)
    hit = raycasting_scene(scene.target_mesh).cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    return hit > distance[:, 0] - SHADOW_BIAS_M


def _balls(scene: Scene) -> Scatterers:
    """The near half of each steel ball's surface, delayed by the foam around it."""
    index = np.arange(BALL_POINTS) + 0.5
    z = 1 - 2 * index / BALL_POINTS  # a Fibonacci lattice: equal areas
    azimuth = np.pi * (1 + np.sqrt(5)) * index
    ring = np.sqrt(1 - z**2)
    normal = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
    parts = []
    for centre, element, delay in zip(scene.balls_m, scene.target.element, scene.target.foam_delay_m, strict=True):
        near = normal[normal @ centre < 0]
        area = 4 * np.pi * element.ball_radius_m**2 / BALL_POINTS
        position = centre + element.ball_radius_m * near
        parts.append((position, np.full(len(near), area), near, np.full(len(near), delay)))
    return Scatterers(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _array(name: str) -> AntennaArray:
    if name == "qar50":
        return qar50()
    return AntennaArray(load_positions(f"{name}/tx_m.csv"), load_positions(f"{name}/rx_m.csv"))
