"""The studio's light: three disc lamps and an ambient glow, baked into the bodies' vertices with their shadows."""

from dataclasses import dataclass

import numpy as np

from bench.scenes.bodies import Body
from radar.support.rays import RaycastingScene, load_open3d


@dataclass(frozen=True)
class Lamp:
    """A disc that faces the board: centre (photo frame) and radius, metres; its irradiance at the board's centre, over
    π, so that a white surface's radiance is 1 where the irradiance is 1."""

    centre_m: tuple[float, float, float]
    radius_m: float
    irradiance: float

    @property
    def reach_m(self) -> float:
        """Distance to the board's centre, where the irradiance is stated."""
        return float(np.linalg.norm(self.centre_m))

    def samples_m(self) -> np.ndarray:
        """Points [LAMP_SAMPLES, 3] spread evenly over the disc."""
        centre_m = np.array(self.centre_m)
        z = centre_m / np.linalg.norm(centre_m)
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        u, v = sunflower(self.radius_m, LAMP_SAMPLES)
        return centre_m + u[:, None] * x + v[:, None] * np.cross(z, x)


LAMPS = (
    Lamp((-0.55, 0.75, 0.85), 0.14, 0.62),
    Lamp((0.85, 0.15, 0.80), 0.18, 0.34),
    Lamp((0.05, -0.55, 0.95), 0.18, 0.16),
)
AMBIENT = 0.30
FACING = AMBIENT + sum(lamp.irradiance * lamp.centre_m[2] / lamp.reach_m for lamp in LAMPS)  # on the board's centre
LAMP_SAMPLES, SKY_SAMPLES = 24, 128
SHADOW_OFFSET_M = 2e-4


@dataclass(frozen=True)
class Light:
    """Light at a body's vertices: irradiance [n] (over π) and the visible share [n, lamps] of each lamp, 0 to 1."""

    irradiance: np.ndarray
    open: np.ndarray


def bake(rays: RaycastingScene, body: Body) -> Light:
    """Light at a body's vertices: the lamps with soft shadows and an occluded ambient light."""
    origins_m = body.vertices_m + SHADOW_OFFSET_M * body.normals
    result = np.zeros(len(origins_m))
    seen = np.zeros((len(origins_m), len(LAMPS)), dtype=np.float32)
    for number, lamp in enumerate(LAMPS):
        samples_m = lamp.samples_m()
        for lamp_m in samples_m:
            towards = lamp_m - origins_m
            distance_m = np.linalg.norm(towards, axis=1)
            cosine = np.maximum(np.einsum("ij,ij->i", towards, body.normals) / distance_m, 0)
            falloff = (lamp.reach_m / distance_m) ** 2
            unshadowed = clear(rays, origins_m, towards, cosine > 0)
            result += lamp.irradiance / len(samples_m) * cosine * falloff * unshadowed
            seen[:, number] += unshadowed / len(samples_m)
    open_sky, whole_sky = np.zeros(len(origins_m)), np.zeros(len(origins_m))
    for direction in _sphere(SKY_SAMPLES):
        cosine = np.maximum(body.normals @ direction, 0)
        whole_sky += cosine
        open_sky += cosine * clear(rays, origins_m, np.broadcast_to(direction, origins_m.shape), cosine > 0)
    return Light(result + AMBIENT * open_sky / whole_sky, seen)


def clear(rays: RaycastingScene, origins_m: np.ndarray, towards: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """1 where nothing stands between an origin [n, 3] and origin + towards [n, 3], else 0; asked only where `wanted`
    [n]."""
    tensor = load_open3d().core.Tensor
    result = np.zeros(len(origins_m))
    query = np.concatenate([origins_m[wanted], towards[wanted]], axis=1).astype(np.float32)
    result[wanted] = ~rays.test_occlusions(tensor(query), tfar=1.0).numpy()
    return result


def sunflower(radius: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates [count], [count] of points spread evenly over a disc."""
    k = np.arange(count) + 0.5
    r, angle = radius * np.sqrt(k / count), k * np.pi * (3 - np.sqrt(5))
    return r * np.cos(angle), r * np.sin(angle)


def _sphere(count: int) -> np.ndarray:
    """Unit directions [count, 3] spread evenly (a Fibonacci lattice)."""
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
