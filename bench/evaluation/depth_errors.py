"""Pixelwise comparison of a depth map with a reference surface: errors along z, and distances
between the two surfaces."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from handbench.support.errors import HandbenchError


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
