"""The radar half of a scene: physical optics over the surface that the array's centre sees, Mie's series for balls."""

from __future__ import annotations

import numpy as np

from bench.scenes.scene import Scene
from calibration.meshes import load_open3d, raycasting_scene
from radar.arrays import AntennaArray, load_positions, qar50
from radar.capture import RadarCapture
from radar.effects.noise import strongest_amplitude, thermal_noise
from radar.forward import Scatterers, simulate
from radar.sphere import sphere_echo

SHADOW_BIAS_M = 2e-4  # a facet does not shadow itself
PEAK_POINTS = 20_000  # surface points on which the strongest pixel is looked for


def echoes(scene: Scene, frames: int = 1) -> RadarCapture:
    """The scene's echoes; the frames differ in their noise alone, which comes from (scene seed, frame)."""
    array = _array(scene.file.sensor.array)
    frequencies_hz = np.unique(scene.file.sensor.frequencies_hz)
    if scene.target is not None:
        clean, surface_m = _balls(scene, frequencies_hz, array), scene.balls_m
    else:
        scatterers = visible_surface(scene)
        clean = simulate(scatterers, frequencies_hz, array)
        surface_m = scatterers.position_m[:: max(1, len(scatterers.position_m) // PEAK_POINTS)]
    phase_noise_rad = scene.file.noise.phase_noise_rad
    if phase_noise_rad == 0:
        return RadarCapture(np.repeat(clean[None], frames, axis=0), frequencies_hz, array)
    strongest = strongest_amplitude(clean[-1], frequencies_hz[-1], array, surface_m)
    seeds = [(scene.file.seed, frame) for frame in range(frames)]
    noisy = np.stack([thermal_noise(clean, frequencies_hz, phase_noise_rad, strongest, seed) for seed in seeds])
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


def _balls(scene: Scene, frequencies_hz: np.ndarray, array: AntennaArray) -> np.ndarray:
    """Echoes of the calibration target's steel balls in their foam."""
    elements, delays_m = scene.target.element, scene.target.foam_delay_m
    return sum(
        sphere_echo(centre, element.ball_radius_m, delay, frequencies_hz, array)
        for centre, element, delay in zip(scene.balls_m, elements, delays_m, strict=True)
    )


def _array(name: str) -> AntennaArray:
    if name == "qar50":
        return qar50()
    return AntennaArray(load_positions(f"{name}/tx_m.csv"), load_positions(f"{name}/rx_m.csv"))
