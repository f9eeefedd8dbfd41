"""The radar half of a scene: physical optics over the surface that the array's centre sees, Mie's series for balls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench.scenes.scene import BUILT_IN_ARRAY, Scene
from calibration.meshes import load_open3d, raycasting_scene
from radar.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, load_positions, qar50
from radar.capture import RadarCapture
from radar.effects.noise import strongest_amplitude, thermal_noise
from radar.errors import HandbenchError
from radar.files import inside
from radar.forward import Scatterers, simulate
from radar.sphere import sphere_echo

if TYPE_CHECKING:
    import open3d as o3d

SHADOW_BIAS_M = 2e-4  # a facet does not shadow itself
MOST_FACETS = 4_000_000
PEAK_POINTS = 20_000  # surface points on which the strongest pixel is looked for


def echoes(scene: Scene, frames: int = 1) -> RadarCapture:
    """The scene's echoes; the frames differ in their noise alone, which comes from (scene seed, frame)."""
    array = antenna_array(scene)
    frequencies_hz = np.unique(scene.file.sensor.frequencies_hz)
    if scene.target is not None:
        clean, surface_m = _balls(scene, frequencies_hz, array), scene.balls_m
    else:
        scatterers = visible_surface(scene, SPEED_OF_LIGHT_M_S / frequencies_hz[-1])
        clean = simulate(scatterers, frequencies_hz, array)
        surface_m = scatterers.position_m[:: max(1, len(scatterers.position_m) // PEAK_POINTS)]
    phase_noise_rad = scene.file.noise.phase_noise_rad
    if phase_noise_rad == 0:
        return RadarCapture(np.repeat(clean[None], frames, axis=0), frequencies_hz, array)
    strongest = strongest_amplitude(clean[-1], frequencies_hz[-1], array, surface_m)
    seeds = [(scene.file.seed, frame) for frame in range(frames)]
    noisy = np.stack([thermal_noise(clean, frequencies_hz, phase_noise_rad, strongest, seed) for seed in seeds])
    return RadarCapture(noisy, frequencies_hz, array)


def visible_surface(scene: Scene, wavelength_m: float) -> Scatterers:
    """Facets of the target that face the aperture's centre and are not in another's shadow, split until no edge is
    longer than a quarter of the wavelength (coarser ones would echo as a grating)."""
    surface = load_open3d().geometry.TriangleMesh(scene.target_mesh)
    surface.compute_vertex_normals()
    longest_m = longest_edge_m(surface)
    splits = max(0, int(np.ceil(np.log2(longest_m / (wavelength_m / 4)))))
    if len(surface.triangles) * 4**splits > MOST_FACETS:
        raise HandbenchError(
            f"target: its longest edge, {1e3 * longest_m:.1f} mm, would have to be split {splits} times to sample the "
            f"wavelength, {1e3 * wavelength_m:.1f} mm, which makes more than {MOST_FACETS} facets; remesh it evenly"
        )
    surface = surface.subdivide_midpoint(splits)
    vertices, faces = np.asarray(surface.vertices), np.asarray(surface.triangles)
    centroid = vertices[faces].mean(axis=1)
    normal = np.asarray(surface.vertex_normals)[faces].mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    seen = ((normal * centroid).sum(axis=1) < 0) & _in_sight(scene, centroid)
    if not seen.any():
        raise HandbenchError("target: no facet faces the array; check the mesh's orientation (normals point outwards)")
    return Scatterers(centroid[seen], area[seen], normal[seen])


def longest_edge_m(surface: o3d.geometry.TriangleMesh) -> float:
    """The longest edge of a mesh, metres."""
    corners = np.asarray(surface.vertices)[np.asarray(surface.triangles)]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())


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


def antenna_array(scene: Scene) -> AntennaArray:
    """The scene's array: built in, or a folder beside the scene file with tx_m.csv and rx_m.csv."""
    if scene.file.sensor.array == BUILT_IN_ARRAY:
        return qar50()
    folder = inside(scene.folder, scene.file.sensor.array, f"sensor.array (built in: {BUILT_IN_ARRAY})")
    return AntennaArray(load_positions(folder / "tx_m.csv"), load_positions(folder / "rx_m.csv"))
