"""A projector of speckle: random bright dots that stand still in space, so that every camera sees the same ones."""

import numpy as np

from bench.scenes.lamps import FACING, SHADOW_OFFSET_M, clear
from bench.scenes.textures import solid_noise
from radar.support.errors import HandbenchError
from radar.support.rays import RaycastingScene

SHARPNESS = 10.0  # of the dots' borders
NOISE_PER_DOT = 0.85  # the noise's wavelength over the dots' mean size along a line
OBLIQUE = np.array([[2, -2, 1], [1, 2, 2]]) / 3  # cuts the noise across its lattice, which would show
NEAREST_M = 0.05  # from the target's origin


class Projector:
    """A point at position_m [3] that lights the target's origin aim_m [3] (photo frame).

    contrast: of the dots there, (max - min) / (max + min); it is the projector's share of the light, and the lamps are
    dimmed to the rest, so that the mean brightness stays. dot_m: size of dots at the target's origin.
    """

    def __init__(self, position_m: np.ndarray, aim_m: np.ndarray, contrast: float, dot_m: float, seed: int) -> None:
        self.position_m, self.contrast, self.dot_m, self.seed = position_m, contrast, dot_m, seed
        self.throw_m = float(np.linalg.norm(aim_m - position_m))
        if self.throw_m < NEAREST_M:
            raise HandbenchError(
                f"photos.speckle_from_m: lies {1e3 * self.throw_m:.0f} mm from the target's origin; expected at least "
                f"{1e3 * NEAREST_M:.0f} mm"
            )
        self.axis = (aim_m - position_m) / self.throw_m
        right = np.cross(self.axis, np.eye(3)[np.abs(self.axis).argmin()])
        self.right = right / np.linalg.norm(right)
        self.down = np.cross(self.axis, self.right)

    def pattern(self, points_m: np.ndarray) -> np.ndarray:
        """Brightness [n] of the picture that is projected onto points [n, 3]: 0 to 1, 1/2 in the mean. It depends on
        the direction from the projector alone; what lies behind the projector stays dark."""
        relative_m = points_m - self.position_m
        along = relative_m @ self.axis / self.throw_m
        before = along > 0
        flat_m = relative_m[before] @ np.stack([self.right, self.down], axis=1) / along[before, None]
        noise = solid_noise(flat_m @ OBLIQUE, NOISE_PER_DOT * self.dot_m, self.seed)
        result = np.zeros(len(points_m), dtype=np.float32)
        result[before] = 0.5 + 0.5 * np.tanh(SHARPNESS * noise)
        return result

    def incidence(self, points_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Cosine of incidence times (throw / distance)² at points [n, 3] with normals [n, 3]."""
        towards = self.position_m - points_m
        distance_m = np.linalg.norm(towards, axis=1)
        cosine = np.maximum(np.einsum("ij,ij->i", towards, normals) / distance_m, 0)
        return cosine * (self.throw_m / distance_m) ** 2

    def beam(self, rays: RaycastingScene, points_m: np.ndarray, normals: np.ndarray, even: bool) -> np.ndarray:
        """Light [n] on its way to points [n, 3] with normals [n, 3], zero in shadows: the irradiance over π that it
        would give a surface that faces it at the throw's distance; even: without dots."""
        picture = 0.5 if even else self.pattern(points_m)
        lit = self.incidence(points_m, normals) > 0
        unshadowed = clear(rays, points_m + SHADOW_OFFSET_M * normals, self.position_m - points_m, lit)
        return 2 * self.contrast * FACING * picture * unshadowed
