"""Light in simulated photographs: three disc lamps and ambient light, computed once at the vertices
of each body, with shadows."""

from dataclasses import dataclass

import numpy as np

from handbench.bench.scenes.bodies import PhotoBody
from handbench.support.rays import RaycastingScene, load_open3d


@dataclass(frozen=True)
class Lamp:
    """A lamp: a disc that faces the board.

    centre_m: in the photo frame. irradiance: that of a surface at the board's centre that faces the
    lamp, divided by π, so that a white surface with irradiance 1 has radiance 1.
    """

    centre_m: tuple[float, float, float]
    radius_m: float
    irradiance: float

    def samples_m(self) -> np.ndarray:
        """Return points [n, 3] spread evenly over the lamp's disc, in the photo frame, metres."""
        centre_m = np.array(self.centre_m)
        z = centre_m / np.linalg.norm(centre_m)
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        k = np.arange(LAMP_SAMPLES) + 0.5
        radius_m, angle = self.radius_m * np.sqrt(k / LAMP_SAMPLES), k * np.pi * (3 - np.sqrt(5))
        u, v = radius_m * np.cos(angle), radius_m * np.sin(angle)
        return centre_m + u[:, None] * x + v[:, None] * np.cross(z, x)


LAMPS = (
    Lamp((-0.55, 0.75, 0.85), 0.14, 0.62),
    Lamp((0.85, 0.15, 0.80), 0.18, 0.34),
    Lamp((0.05, -0.55, 0.95), 0.18, 0.16),
)
AMBIENT = 0.30
LAMP_SAMPLES, SKY_SAMPLES = 24, 128
SHADOW_OFFSET_M = 2e-4


def bake(rays: RaycastingScene, body: PhotoBody) -> np.ndarray:
    """Compute the light at the n vertices of a body: from the lamps with soft shadows, and ambient
    light from the directions that no surface hides. rays: ray caster of all bodies. Returns the
    irradiance [n], divided by π."""
    origins_m = body.vertices_m + SHADOW_OFFSET_M * body.normals
    result = np.zeros(len(origins_m))
    for lamp in LAMPS:
        samples_m, reach_m = lamp.samples_m(), np.linalg.norm(lamp.centre_m)
        for lamp_m in samples_m:
            towards = lamp_m - origins_m
            distance_m = np.linalg.norm(towards, axis=1)
            cosine = np.maximum(np.einsum("ij,ij->i", towards, body.normals) / distance_m, 0)
            falloff = (reach_m / distance_m) ** 2
            unshadowed = clear(rays, origins_m, towards, cosine > 0)
            result += lamp.irradiance / len(samples_m) * cosine * falloff * unshadowed
    open_sky, whole_sky = np.zeros(len(origins_m)), np.zeros(len(origins_m))
    for direction in _sphere():
        cosine = np.maximum(body.normals @ direction, 0)
        whole_sky += cosine
        open_sky += cosine * clear(
            rays, origins_m, np.broadcast_to(direction, origins_m.shape), cosine > 0
        )
    return result + AMBIENT * open_sky / whole_sky


def clear(
    rays: RaycastingScene, origins_m: np.ndarray, towards: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """Test for each of n points whether nothing lies between it and a second point.

    origins_m [n, 3]: the points; towards [n, 3]: vectors to the second points. Returns 1.0 [n] for
    a free path and 0.0 for a blocked one. Only points in the mask wanted [n] are tested; others get
    0.
    """
    tensor = load_open3d().core.Tensor
    result = np.zeros(len(origins_m))
    query = np.concatenate([origins_m[wanted], towards[wanted]], axis=1).astype(np.float32)
    result[wanted] = ~rays.test_occlusions(tensor(query), tfar=1.0).numpy()
    return result


def _sphere() -> np.ndarray:
    """Return unit directions [SKY_SAMPLES, 3] that are spread evenly over the sphere (a Fibonacci
    lattice)."""
    k = np.arange(SKY_SAMPLES)
    z = 1 - 2 * (k + 0.5) / SKY_SAMPLES
    angle = k * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
