"""Errors grouped by cause, and reliability of a depth map's σ.

The causes are incidence angle, amplitude, part of the hand (finger or palm) and distance to an
edge. An edge is between two neighbouring pixels if only one has a reference, or if their depths
differ by more than 5 mm (JUMP_M). No slope is computed across an edge. The border of the image is
no edge. Reliability is the share of errors inside the intervals that σ gives, and the likelihood of
the errors.
"""

from collections.abc import Iterator
from itertools import pairwise
from statistics import NormalDist
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.tables import Schema, frame
from handbench.radar.data.depthmap import DepthMap

NOMINAL_PERCENT = (50, 68, 80, 90, 95, 99)


def reliability_lines(depth: DepthMap, errors: ErrorMap) -> Iterator[dict[str, object]]:
    """Yield one capture's lines of the table RELIABILITY: how well the map's σ predicts its errors.
    Each line has a nominal interval in percent and the share of errors inside it, for all pixels or
    for those that are not marked as wrapped in phase. σ of the map and, if known, of the reference
    are added in quadrature. Yields nothing if the map has no σ."""
    if depth.sigma_m is None:
        return
    reference_m = (
        np.full(errors.error_m.shape, np.nan) if errors.sigma_m is None else errors.sigma_m
    )
    sigma_mm = 1e3 * np.hypot(depth.sigma_m, np.nan_to_num(reference_m))
    usable = np.isfinite(errors.error_m) & np.isfinite(sigma_mm) & (sigma_mm > 0)
    known = bool(np.isfinite(reference_m[usable]).all())
    sure = usable if depth.wrapped is None else usable & ~depth.wrapped
    for pixels, chosen in (("all", usable), ("not flagged", sure)):
        error_mm, spread_mm = 1e3 * errors.error_m[chosen], sigma_mm[chosen]
        facts = {"pixels": pixels, "reference_sigma": known, "n_pixels": len(error_mm)}
        facts |= {"nll": negative_log_likelihood(error_mm, spread_mm)}
        for nominal in NOMINAL_PERCENT:
            yield facts | {
                "nominal_percent": nominal,
                "observed_percent": coverage_percent(error_mm / spread_mm, nominal),
            }


def coverage_percent(deviations: np.ndarray, nominal_percent: float) -> float:
    """Return the percentage of errors inside the normal distribution's central interval of
    nominal_percent.
    deviations [n]: errors divided by their σ. NaN if there are none."""
    reach = NormalDist().inv_cdf(0.5 + nominal_percent / 200)
    return 100 * float(np.mean(np.abs(deviations) <= reach)) if len(deviations) else np.nan


def negative_log_likelihood(error_mm: np.ndarray, sigma_mm: np.ndarray) -> float:
    """Return the mean of −ln N(e; 0, σ²) over errors e [n] and their standard deviations σ [n],
    both in mm.
    NaN if there are no errors. If all σ are equal and right, it is ½ ln(2πe σ²)."""
    each = 0.5 * (np.log(2 * np.pi * sigma_mm**2) + (error_mm / sigma_mm) ** 2)
    return float(each.mean()) if len(each) else np.nan


JUMP_M = 5e-3  # a smooth surface that rises as much within 1 mm is inclined by 79°
PALM_RADIUS_M = 22e-3  # two fingers side by side are 40 mm wide, a palm 70 to 100 mm
# of the silhouette, of either part: a target that is no hand has less, and four closed fingers
LEAST_SHARE = 0.1
PARTS = ("finger", "palm")
BINS = {  # a bin holds its lower edge
    "incidence_deg": (0, 5, 10, 15, 20, 30, 45, np.inf),
    "below_maximum_db": (0, 3, 6, 10, 13, np.inf),
    "part": (),
    "edge_distance_mm": (0, 2, 4, 8, 16, np.inf),
}
Part = tuple[slice, slice]
ALL, BEFORE, BEHIND = slice(None), slice(None, -1), slice(1, None)
# x, then y
ALONG: tuple[tuple[Part, Part], ...] = (
    ((ALL, BEFORE), (ALL, BEHIND)),
    ((BEFORE, ALL), (BEHIND, ALL)),
)
# formed for each capture
MEANS = ("mean_mm", "median_mm", "absolute_mm", "p95_mm", "observed_percent", "nll")


class Averages:
    """Averages over captures of the figures in the table CAUSES or RELIABILITY.
    The lines of single captures are added one at a time. A figure is averaged over the captures
    that have it; pixels are counted over all captures."""

    def __init__(self, schema: Schema) -> None:
        self.schema, self.means = schema, [name for name in schema.names if name in MEANS]
        self.keys = [
            name for name in schema.names if name not in (*self.means, "n_pixels", "n_captures")
        ]
        self.sums: dict[
            tuple[Any, ...], np.ndarray
        ] = {}  # of figures; how many have them; pixels; captures with some

    def add(self, line: dict[str, Any]) -> None:
        """Add one line of one capture: column → value; `n_pixels`, the number of pixels, is
        required."""
        values, pixels = np.array([line.get(name) for name in self.means], float), line["n_pixels"]
        known = np.isfinite(values)
        place = self.sums.setdefault(
            tuple(line.get(name) for name in self.keys), np.zeros(2 * len(self.means) + 2)
        )
        place += [*np.where(known, values, 0.0), *known, pixels, pixels > 0]

    def table(self) -> pd.DataFrame:
        """Return the table of averages. Groups of pixels that are empty in every capture are left
        out."""
        found = []
        for key, summed in self.sums.items():
            if summed[-2]:
                with np.errstate(invalid="ignore"):
                    figures = summed[: len(self.means)] / summed[len(self.means) : -2]
                counts = {"n_pixels": int(summed[-2]), "n_captures": int(summed[-1])}
                about = dict(zip(self.keys, key, strict=True))
                found.append(about | dict(zip(self.means, figures, strict=True)) | counts)
        return frame(self.schema, found)


def cause_lines(
    depth: DepthMap, errors: ErrorMap, surface: dict[str, np.ndarray]
) -> Iterator[dict[str, object]]:
    """Yield one capture's lines of the table CAUSES: the figures of the errors in each interval of
    each cause.
    Causes are incidence angle, level below the image's maximum, part of the hand, and distance to
    an edge; BINS has the limits of the intervals.
    surface: cause → its value at each pixel [ny, nx], for the causes that follow from the reference
    surface."""
    observed = np.isfinite(errors.error_m)
    error_mm = 1e3 * errors.error_m[observed]
    values = {
        name: of[observed]
        for name, of in (surface | {"below_maximum_db": -depth.amplitude_db}).items()
    }
    for cause, edges in BINS.items():
        for i, part in enumerate(PARTS if cause == "part" else ()):
            yield {"cause": cause, "part": part, **_figures(error_mm[values[cause] == i])}
        for low, high in pairwise(edges):
            inside = (values[cause] >= low) & ((values[cause] < high) | (high == np.inf))
            yield {
                "cause": cause,
                "part": "",
                "low": low,
                "high": high,
                **_figures(error_mm[inside]),
            }


def _figures(error_mm: np.ndarray) -> dict[str, float]:
    """Return the number of errors [n], mm, and their mean, median, absolute mean and 95th
    percentile of |e|.
    If there are no errors, only their number 0 is returned."""
    if not len(error_mm):
        return {"n_pixels": 0}
    absolute_mm = np.abs(error_mm)
    means = {
        "mean_mm": error_mm.mean(),
        "median_mm": np.median(error_mm),
        "absolute_mm": absolute_mm.mean(),
    }
    return {"n_pixels": len(error_mm), **means, "p95_mm": np.quantile(absolute_mm, 0.95)}


def surface_causes(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray) -> dict[str, np.ndarray]:
    """Compute the possible causes of error that follow from the reference surface: cause → values
    [ny, nx].
    These are incidence angle (degrees), part of the hand (0: finger, 1: palm), and distance to an
    edge (mm); NaN where unknown. z_m [ny, nx]: depths of the reference on x_m [nx], y_m [ny],
    metres."""
    return {
        "incidence_deg": incidence_deg(x_m, y_m, z_m),
        "part": parts(x_m, y_m, z_m),
        "edge_distance_mm": 1e3 * edge_distance_m(x_m, y_m, z_m),
    }


def incidence_deg(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray) -> np.ndarray:
    """Compute the incidence angle [ny, nx], degrees: the angle between the surface normal and the
    direction to the centre of the array, the origin.
    z_m [ny, nx]: depths on x_m [nx], y_m [ny], metres. The slope along x or y is the mean of the
    slopes to both neighbours. If one of these crosses an edge (a jump of more than 5 mm, JUMP_M),
    the other is used; if both do, the angle is NaN."""
    x, y = np.meshgrid(x_m, y_m)
    slopes = []
    for (before, behind), along_m in zip(ALONG, (x, y), strict=True):
        rise = z_m[behind] - z_m[before]
        slope = np.where(np.abs(rise) > JUMP_M, np.nan, rise / (along_m[behind] - along_m[before]))
        forth, back = np.full(z_m.shape, np.nan), np.full(z_m.shape, np.nan)
        forth[before], back[behind] = slope, slope
        slopes.append(
            np.where(np.isnan(forth), back, np.where(np.isnan(back), forth, (forth + back) / 2))
        )
    to_centre = z_m - x * slopes[0] - y * slopes[1]
    cosine = to_centre / np.sqrt((x**2 + y**2 + z_m**2) * (1 + slopes[0] ** 2 + slopes[1] ** 2))
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def edge_distance_m(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray) -> np.ndarray:
    """Compute the lateral distance [ny, nx], metres, from each pixel to the nearest edge of the
    surface.
    z_m [ny, nx]: depths on x_m [nx], y_m [ny], metres. An edge is the point midway between two
    neighbouring pixels of which one has no depth, or whose depths differ by more than 5 mm
    (JUMP_M). Infinite if there is no edge, NaN where there is no depth."""
    from scipy.spatial import KDTree

    pixels, surface = np.stack(np.meshgrid(x_m, y_m), axis=-1), np.isfinite(z_m)
    edges = []
    for before, behind in ALONG:
        at = (surface[before] != surface[behind]) | (np.abs(z_m[behind] - z_m[before]) > JUMP_M)
        edges.append((pixels[before][at] + pixels[behind][at]) / 2)
    distance_m = np.full(z_m.shape, np.nan)
    distance_m[surface] = KDTree(np.concatenate(edges)).query(pixels[surface])[0]
    return distance_m


def parts(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray) -> np.ndarray:
    """Split a hand into finger (0) and palm (1): returns the number for each pixel [ny, nx].
    z_m [ny, nx]: depths on x_m [nx], y_m [ny], metres. The palm is what a morphological opening
    with a disc of 22 mm radius (PALM_RADIUS_M) leaves of the filled silhouette. NaN where there is
    no depth, and everywhere if one part has less than a tenth of the pixels (LEAST_SHARE)."""
    from scipy.ndimage import binary_fill_holes, distance_transform_edt

    surface = np.isfinite(z_m)
    silhouette, part = binary_fill_holes(surface), np.full(z_m.shape, np.nan)
    pixel_m = np.diff(y_m).mean(), np.diff(x_m).mean()
    if silhouette.all():
        return part
    core = distance_transform_edt(silhouette, pixel_m) > PALM_RADIUS_M
    palm = (
        silhouette & (distance_transform_edt(~core, pixel_m) <= PALM_RADIUS_M)
        if core.any()
        else core
    )
    if LEAST_SHARE <= palm.sum() / max(silhouette.sum(), 1) <= 1 - LEAST_SHARE:
        part[surface] = palm[surface]
    return part
