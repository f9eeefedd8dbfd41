"""Light in simulated photographs.

Three disc lamps and ambient light are computed once at the vertices of each body, with shadows.
Highlights are reflections of the lamps on a rough surface (Cook & Torrance 1982; for skin, Weyrich
et al. 2006). A speckle projector casts random bright dots that are fixed in space, so that every
camera sees the same ones.
"""

from dataclasses import dataclass

import numpy as np

from handbench.bench.scenes.bodies import PhotoBody
from handbench.bench.scenes.textures import solid_noise
from handbench.support.compiled import njit
from handbench.support.errors import HandbenchError
from handbench.support.parallel import for_each
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

    @property
    def reach_m(self) -> float:
        """Distance from the lamp to the board's centre, for which `irradiance` is given, metres."""
        return float(np.linalg.norm(self.centre_m))

    def samples_m(self) -> np.ndarray:
        """Return points [n, 3] spread evenly over the lamp's disc, in the photo frame, metres."""
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
# on the board's centre
FACING = AMBIENT + sum(lamp.irradiance * lamp.centre_m[2] / lamp.reach_m for lamp in LAMPS)
LAMP_SAMPLES, SKY_SAMPLES = 24, 128
SHADOW_OFFSET_M = 2e-4


@dataclass(frozen=True)
class Light:
    """Light at the n vertices of a body.

    irradiance [n]: from lamps and ambient light, with shadows, divided by π. open [n, lamps]:
    fraction of each lamp that other surfaces do not hide, 0 to 1.
    """

    irradiance: np.ndarray
    open: np.ndarray


def bake(rays: RaycastingScene, body: PhotoBody) -> Light:
    """Compute the light at the vertices of a body: from the lamps with soft shadows, and ambient
    light from the directions that no surface hides. rays: ray caster of all bodies."""
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
        open_sky += cosine * clear(
            rays, origins_m, np.broadcast_to(direction, origins_m.shape), cosine > 0
        )
    return Light(result + AMBIENT * open_sky / whole_sky, seen)


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


def sunflower(radius: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the x [count] and y [count] of points that are spread evenly over a disc of this
    radius."""
    k = np.arange(count) + 0.5
    r, angle = radius * np.sqrt(k / count), k * np.pi * (3 - np.sqrt(5))
    return r * np.cos(angle), r * np.sin(angle)


def _sphere(count: int) -> np.ndarray:
    """Return unit directions [count, 3] that are spread evenly over the sphere (a Fibonacci
    lattice)."""
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


SHARPNESS = 10.0  # of the dots' borders
NOISE_PER_DOT = 0.85  # the noise's wavelength over the dots' mean size along a line
# cuts the noise across its lattice, which would show
OBLIQUE = np.array([[2, -2, 1], [1, 2, 2]]) / 3
NEAREST_M = 0.05  # from the target's origin


class Projector:
    """A projector of random dots at position_m [3], aimed at the target's origin aim_m [3] (photo
    frame).

    contrast: of the dots at the target's origin, (max − min) / (max + min). It is also the
    projector's share of the light: the lamps are dimmed so that the mean brightness stays the same.
    dot_m: size of the dots at the target's origin. seed: of the dots. Raises HandbenchError for a
    position within 50 mm of the target's origin.
    """

    def __init__(
        self, position_m: np.ndarray, aim_m: np.ndarray, contrast: float, dot_m: float, seed: int
    ) -> None:
        self.position_m, self.contrast, self.dot_m, self.seed = position_m, contrast, dot_m, seed
        self.throw_m = float(np.linalg.norm(aim_m - position_m))
        if self.throw_m < NEAREST_M:
            raise HandbenchError(
                f"photos.speckle_from_m: is {1e3 * self.throw_m:.0f} mm from the origin of the "
                f"target; expected at least {1e3 * NEAREST_M:.0f} mm"
            )
        self.axis = (aim_m - position_m) / self.throw_m
        right = np.cross(self.axis, np.eye(3)[np.abs(self.axis).argmin()])
        self.right = right / np.linalg.norm(right)
        self.down = np.cross(self.axis, self.right)

    def pattern(self, points_m: np.ndarray) -> np.ndarray:
        """Compute the brightness [n] of the dots at points [n, 3]: 0 to 1, with mean 1/2. It
        depends only on a point's direction from the projector, and is 0 behind the projector."""
        relative_m = points_m - self.position_m
        along = relative_m @ self.axis / self.throw_m
        before = along > 0
        flat_m = (
            relative_m[before] @ np.stack([self.right, self.down], axis=1) / along[before, None]
        )
        noise = solid_noise(flat_m @ OBLIQUE, NOISE_PER_DOT * self.dot_m, self.seed)
        result = np.zeros(len(points_m), dtype=np.float32)
        result[before] = 0.5 + 0.5 * np.tanh(SHARPNESS * noise)
        return result

    def incidence(self, points_m: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Compute how strongly the projector lights points [n, 3] with unit normals [n, 3], without
        dots and shadows, relative to a surface at the target's origin that faces it.

        The result [n] is the cosine of incidence times (throw / distance)², where the throw is the
        distance from the projector to the target's origin.
        """
        towards = self.position_m - points_m
        distance_m = np.linalg.norm(towards, axis=1)
        cosine = np.maximum(np.einsum("ij,ij->i", towards, normals) / distance_m, 0)
        return cosine * (self.throw_m / distance_m) ** 2

    def beam(
        self, rays: RaycastingScene, points_m: np.ndarray, normals: np.ndarray, even: bool
    ) -> np.ndarray:
        """Compute the projector's light [n] that travels towards points [n, 3] with normals [n, 3],
        without the effects of distance and incidence; 0 in shadow.

        Its unit is the irradiance, divided by π, of a surface that faces the projector at the
        target's origin. rays: ray caster of all bodies. even: True for light of the same mean
        without dots.
        """
        picture = 0.5 if even else self.pattern(points_m)
        lit = self.incidence(points_m, normals) > 0
        unshadowed = clear(
            rays, points_m + SHADOW_OFFSET_M * normals, self.position_m - points_m, lit
        )
        return 2 * self.contrast * FACING * picture * unshadowed


# at normal incidence: ((n - 1) / (n + 1))² with skin's refractive index n = 1.4
SKIN_REFLECTANCE = 0.028
GRAZING = 1e-3  # smallest cosine towards the eye: interpolated normals may turn a little beyond 90°
BLOCK = 20_000  # points per task


@njit()
def ggx(
    to_half: float,
    to_light: float,
    to_eye: float,
    tilt: float,
    roughness: float,
    reflectance: float,
) -> float:
    """Compute the specular part of a rough surface's BRDF, 1/sr.

    The first arguments are cosines, with the normal n, the light's direction l, the eye's direction
    v, and the half vector h between l and v: to_half = n·h, to_light = n·l, to_eye = n·v (the last
    two above 0), tilt = h·v. roughness: α; reflectance: R at normal incidence.

    The result is D F V. D = α² / (π ((n·h)² (α² - 1) + 1)²) is the distribution of the normals of
    small facets (GGX, Walter et al. 2007). F = R + (1 - R) (1 - h·v)⁵ is the Fresnel term (Schlick
    1994). V is the height-correlated masking of facets by each other, divided by 4 (n·l) (n·v)
    (Heitz 2014).
    """
    square = roughness**2
    spread = square / (np.pi * (to_half**2 * (square - 1) + 1) ** 2)
    fresnel = reflectance + (1 - reflectance) * (1 - tilt) ** 5
    hidden = to_light * np.sqrt(to_eye**2 * (1 - square) + square)
    hidden += to_eye * np.sqrt(to_light**2 * (1 - square) + square)
    return spread * fresnel / (2 * hidden)


def mirrored(
    points_m: np.ndarray,
    normals: np.ndarray,
    eyes: np.ndarray,
    lamp_m: np.ndarray,
    reach_m: float,
    roughness: float,
) -> np.ndarray:
    """Compute the radiance [n] of a lamp's highlight on skin at points [n, 3], per unit of the
    lamp's irradiance; shadows are ignored.

    normals [n, 3]: unit normals. eyes [n, 3]: unit vectors to the camera. lamp_m [k, 3]: points of
    the lamp. reach_m: distance at which the lamp's irradiance is given. roughness: of the skin
    (GGX's α).
    """
    result = np.empty(len(points_m), dtype=np.float32)

    def work(first: int) -> None:
        part = slice(first, first + BLOCK)
        _mirrored(
            points_m[part], normals[part], eyes[part], lamp_m, reach_m, roughness, result[part]
        )

    for_each(work, range(0, len(points_m), BLOCK))
    return result


@njit(nogil=True, cache=True)
def _mirrored(
    points_m: np.ndarray,
    normals: np.ndarray,
    eyes: np.ndarray,
    lamp_m: np.ndarray,
    reach_m: float,
    roughness: float,
    result: np.ndarray,
) -> None:
    """Compute the radiance of a lamp's highlight at points [n, 3] of skin, per unit of the lamp's
    irradiance, and write it into `result` [n].

    It is the rendering equation summed over k points lamp_m [k, 3] of the lamp: π / k Σ brdf cos θ
    (reach / distance)², with the angle of incidence θ and the distance reach_m at which the
    irradiance is given. normals [n, 3]: unit normals. eyes [n, 3]: unit vectors to the camera.
    roughness: of the skin.
    """
    for i in range(len(points_m)):
        px, py, pz = points_m[i, 0], points_m[i, 1], points_m[i, 2]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        ex, ey, ez = eyes[i, 0], eyes[i, 1], eyes[i, 2]
        to_eye = max(nx * ex + ny * ey + nz * ez, GRAZING)
        total = 0.0
        for k in range(len(lamp_m)):
            lx, ly, lz = lamp_m[k, 0] - px, lamp_m[k, 1] - py, lamp_m[k, 2] - pz
            distance_m = np.sqrt(lx * lx + ly * ly + lz * lz)
            to_light = (nx * lx + ny * ly + nz * lz) / distance_m
            if to_light > 0:
                hx, hy, hz = lx / distance_m + ex, ly / distance_m + ey, lz / distance_m + ez
                length = np.sqrt(hx * hx + hy * hy + hz * hz)
                # |l + v| = 2 h·v
                to_half, tilt = ((nx * hx + ny * hy + nz * hz) / length, min(length / 2, 1.0))
                brdf = ggx(to_half, to_light, to_eye, tilt, roughness, SKIN_REFLECTANCE)
                total += brdf * to_light * (reach_m / distance_m) ** 2
        result[i] = np.pi / len(lamp_m) * total
