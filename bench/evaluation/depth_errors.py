"""Comparison of a depth map with a reference surface: errors along z, distances between the two
surfaces, errors of radial velocities, σ of both; and the scatter of depths over repeated frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from handbench.support.errors import HandbenchError

if TYPE_CHECKING:
    from handbench.groundtruth.mesh.depth import Reference
    from handbench.radar.data.depthmap import DepthMap

BAND = 1.96  # standard deviations that contain 95 % of a normal error
NOMINAL_PERCENT = (50, 68, 80, 90, 95, 99)
PARTS = ("mesh", "registration")  # of a reference's uncertainty


@dataclass(frozen=True)
class ErrorMap:
    """Signed errors of one depth map against a reference, on the pixel centres x_m [nx], y_m [ny].

    All other arrays are [ny, nx], metres. error_m: z − z_ref, NaN where either is missing.
    reference_z_m: depth of the reference, NaN where it has no surface. sigma_m: standard deviation
    of the reference along z. to_reference_m: distance from the map's point to the nearest point of
    the reference, NaN where that cannot be judged. to_map_m: distance from the reference's point to
    the nearest point of the map. The last three are None if unknown.
    """

    x_m: np.ndarray
    y_m: np.ndarray
    error_m: np.ndarray
    reference_z_m: np.ndarray
    sigma_m: np.ndarray | None = None
    to_reference_m: np.ndarray | None = None
    to_map_m: np.ndarray | None = None


def error_map(
    x_m: np.ndarray,
    y_m: np.ndarray,
    z_m: np.ndarray,
    reference_z_m: np.ndarray,
    sigma_m: np.ndarray | None = None,
    met: np.ndarray | None = None,
) -> ErrorMap:
    """Compute the signed errors of a depth map, pixel by pixel, and the distances between map and
    reference.
    z_m, reference_z_m [ny, nx]: depths of the map and of the reference, metres, on the pixel
    centres x_m [nx], y_m [ny]; NaN or infinite where there is none.
    sigma_m [ny, nx]: standard deviation of the reference along z.
    met [ny, nx]: whether the ray through the pixel hits any surface, observed or interpolated.
    Without it the distances are None, because a depth outside the reference's silhouette cannot be
    judged.
    Raises HandbenchError if the arrays do not fit the grid."""
    for name, given in (
        ("depth map", z_m),
        ("sigma_m", sigma_m),
        ("met", met),
        ("reference", reference_z_m),
    ):
        if given is not None and given.shape != (len(y_m), len(x_m)):
            raise HandbenchError(
                f"{name}: has shape {given.shape}, but the depth map has {(len(y_m), len(x_m))} "
                "[ny, nx]; render the reference on the depth map's grid"
            )
    reference_z_m = np.where(np.isfinite(reference_z_m), reference_z_m, np.nan).astype(np.float64)
    z_m = np.where(np.isfinite(z_m), z_m, np.nan)
    x_m, y_m = np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)
    distances = (None, None) if met is None else _distances(x_m, y_m, z_m, reference_z_m, met)
    return ErrorMap(x_m, y_m, z_m - reference_z_m, reference_z_m, sigma_m, *distances)


def _distances(
    x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray, reference_z_m: np.ndarray, met: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute nearest-point distances between the surface of a depth map and the reference.
    Returns two arrays [ny, nx], metres, NaN elsewhere: for each point of the map that can be
    judged, its distance to the reference; and for each point of the reference, its distance to the
    map. A point of the map can be judged if its pixel has a reference depth, or certainly shows no
    surface at all. met [ny, nx]: whether the ray through the pixel hits any surface."""
    from scipy.spatial import KDTree

    surface = np.isfinite(reference_z_m)
    judged = np.isfinite(z_m) & (surface | _empty((met | surface).tobytes(), surface.shape))
    x, y = np.meshgrid(x_m, y_m)
    found, expected = (
        np.stack([x[at], y[at], z[at]], axis=-1)
        for at, z in ((judged, z_m), (surface, reference_z_m))
    )
    to_reference_m, to_map_m = np.full(z_m.shape, np.nan), np.full(z_m.shape, np.nan)
    to_reference_m[judged] = KDTree(expected).query(found)[0]
    to_map_m[surface] = KDTree(found).query(expected)[0]
    return to_reference_m, to_map_m


@lru_cache(maxsize=4)  # the methods that are compared with one reference share it
def _empty(met: bytes, shape: tuple[int, int]) -> np.ndarray:
    """Find the pixels [ny, nx] that certainly show no surface: rays through them and their
    neighbours hit none, and no closed outline of surface surrounds them.
    met: whether the ray through each pixel hits a surface, as the bytes of a boolean array of
    `shape`."""
    from scipy.ndimage import binary_dilation, binary_fill_holes

    return ~binary_dilation(
        binary_fill_holes(np.frombuffer(met, bool).reshape(shape)), np.ones((3, 3))
    )


class Pixels:
    """The pixels of an error map that have an error, a reference or a distance, in one row [n]; the
    others add nothing to any metric.

    observed, judged [n]: whether the pixel has an error, and a judgement of the map's point.
    n_observed, n_surface, n_judged: how many have an error, a reference (NaN instead of no surface)
    and a judgement (NaN where nothing could be judged). error_m, absolute_m, depth_m [n]: error,
    its absolute value and the depth of the reference, 0 where not observed. seen_m, sigma_m:
    absolute errors of the observed pixels, and standard deviations of the reference there. mean_m,
    mean_square_m2: mean absolute and mean square error. to_reference_m, to_map_m: mean distance of
    the map's judged points to the reference, and of the reference's points to the map."""

    def __init__(self, errors: ErrorMap) -> None:
        unknown = np.full(errors.error_m.shape, np.nan)
        maps = [unknown if of is None else of for of in list(vars(errors).values())[2:]]
        error_m, z_m, sigma_m, to_reference_m, to_map_m = maps
        used = ~np.isnan([error_m, z_m, to_reference_m]).all(axis=0)
        error_m, z_m, sigma_m, to_reference_m, to_map_m = (of[used] for of in maps)
        self.observed = np.isfinite(error_m)
        self.judged = ~np.isnan(to_reference_m)
        surface = np.isfinite(z_m)
        self.error_m = np.where(self.observed, error_m, 0.0)
        self.absolute_m = np.abs(self.error_m)
        self.depth_m = np.where(self.observed, z_m, 0.0)
        self.seen_m = self.absolute_m[self.observed]
        self.sigma_m = sigma_m[self.observed]
        self.n_observed = np.float64(self.observed.sum())
        self.n_surface = np.float64(surface.sum() or np.nan)
        self.n_judged = np.float64(np.nan if errors.to_reference_m is None else self.judged.sum())
        self.mean_m = self.absolute_m.sum() / self.n_observed
        self.mean_square_m2 = (self.error_m**2).sum() / self.n_observed
        self.to_reference_m = np.where(self.judged, to_reference_m, 0.0).sum() / self.n_judged
        self.to_map_m = np.where(surface, to_map_m, 0.0).sum() / self.n_surface


def deviation_map(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray) -> ErrorMap:
    """Compute the standard deviation (n − 1) of each pixel's depth over repeated frames, z_m [n ≥
    2, ny, nx], metres.
    Returns an ErrorMap whose error_m holds the deviations, NaN where a frame does not observe the
    pixel. The median of its pixels is the precision per pixel."""
    # in double precision, for of 1 µm about 0.3 m a float32 mean would leave nothing
    several = len(z_m) > 1
    deviation_m = (
        np.std(z_m, axis=0, ddof=1, dtype=np.float64) if several else np.full(z_m.shape[1:], np.nan)
    )
    return ErrorMap(
        np.asarray(x_m, np.float64), np.asarray(y_m, np.float64), deviation_m, deviation_m
    )


def strongest_scatterer_z_m(z_m: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """Return the depth [n], metres, of the strongest scatterer in each repeated frame, from which
    the precision is computed.
    z_m, amplitude [n, ny, nx]: depths, metres, and linear amplitudes. The same pixel is used in all
    frames: of the pixels observed in every frame, the one with the largest mean amplitude. (The
    strongest pixel of each frame could jump between glints of nearly equal strength; the distance
    between these would then be measured.) NaN if there is no such pixel."""
    steady = np.isfinite(z_m).all(axis=0) & ~np.isnan(amplitude).any(axis=0)
    if not steady.any():
        return np.full(len(z_m), np.nan)
    strongest = np.argmax(np.where(steady, amplitude.mean(axis=0), -np.inf))
    return z_m.reshape(len(z_m), -1)[:, strongest]


class VelocityErrors(NamedTuple):
    """Errors of radial velocities at the n compared pixels, m/s. within [n]: 1 for an error inside
    the map's own 95 % interval, 0 for another; beyond [n]: 1 for a true velocity beyond the map's
    unambiguous one; both NaN if the map does not say."""

    error_m_s: np.ndarray
    within: np.ndarray
    beyond: np.ndarray


def velocity_errors(
    depth: DepthMap, scored_m: np.ndarray, reference: Reference
) -> VelocityErrors | None:
    """Compare a depth map's radial velocities with those of a surface; None if either has none.
    scored_m [ny, nx]: errors of the scored depths, NaN elsewhere; compared are those pixels where
    map and reference have a velocity."""
    if depth.velocity_m_s is None or reference.velocity_m_s is None:
        return None
    at = np.isfinite([scored_m, depth.velocity_m_s, reference.velocity_m_s]).all(axis=0)
    true_m_s = reference.velocity_m_s[at]
    error_m_s = depth.velocity_m_s[at].astype(np.float64) - true_m_s
    unknown = np.full(len(error_m_s), np.nan)
    sigma_m_s, limit_m_s = depth.velocity_sigma_m_s, depth.velocity_limit_m_s
    return VelocityErrors(
        error_m_s,
        unknown if sigma_m_s is None else np.abs(error_m_s) <= BAND * sigma_m_s[at],
        unknown if limit_m_s is None else np.abs(true_m_s) > limit_m_s,
    )


def mean_speed_m_s(reference: Reference) -> float | None:
    """Return the mean |radial velocity| of a reference's surface, metres per second; None if it is
    unknown."""
    if reference.velocity_m_s is None or not np.isfinite(reference.velocity_m_s).any():
        return None
    return float(np.nanmean(np.abs(reference.velocity_m_s)))


def coverage_percent(depth: DepthMap, errors: ErrorMap) -> dict[int, float]:
    """Return the share of a map's errors inside the central normal intervals about its depths:
    nominal → observed, percent. σ of the map and, where known, of the reference are added in
    quadrature. Empty if the map has no σ, or no pixel with an error and a σ above 0."""
    if depth.sigma_m is None:
        return {}
    reference_m = 0.0 if errors.sigma_m is None else np.nan_to_num(errors.sigma_m)
    sigma_m = np.hypot(depth.sigma_m, reference_m)
    usable = np.isfinite(errors.error_m) & np.isfinite(sigma_m) & (sigma_m > 0)
    if not usable.any():
        return {}
    deviations = np.abs(errors.error_m[usable]) / sigma_m[usable]
    reach = NormalDist().inv_cdf
    return {p: 100 * float(np.mean(deviations <= reach(0.5 + p / 200))) for p in NOMINAL_PERCENT}


def budget(reference: Reference) -> dict[str, float | list[str] | None]:
    """Return the uncertainty of a reference by source: mesh_mm, registration_mm and together_mm.
    Each is the root mean square, mm, of σ along z over the pixels of the reference. It is None if
    unknown, and the unknown sources are then listed under "unknown"."""
    surface = np.isfinite(reference.z_m)
    sigmas_m = (reference.mesh_sigma_m, reference.registration_sigma_m, reference.sigma_m)
    named = zip((*PARTS, "together"), sigmas_m, strict=True)
    parts = {f"{name}_mm": _rms_mm(sigma_m[surface]) for name, sigma_m in named}
    unknown = [name for name in PARTS if parts[f"{name}_mm"] is None]
    return {**parts, **({"unknown": unknown} if unknown else {})}


def _rms_mm(sigma_m: np.ndarray) -> float | None:
    if not len(sigma_m) or not np.isfinite(sigma_m).all():
        return None
    return float(1e3 * np.sqrt((sigma_m**2).mean()))
