"""Mistakes in frames and lengths, told by a depth map beside a surface: undone, the two agree better.

The surface is moved as it would have to be if it were mirrored, exchanged or in another unit, and the pixels of the map
that come to lie on it are counted. What is a mistake of the surface may as well be one of the antennas' positions: only
one of both can be seen from where they differ.
"""

from dataclasses import dataclass

import numpy as np

from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.depthmap import DepthMap
from handbench.support.errors import HandbenchError

NEAR_M = 3e-3  # a pixel that close lies on the surface
STRONGEST = 1500  # pixels that are looked at, at most: those that shine most
CERTAIN, GAINED = 0.3, 1.5  # share of pixels on the undone surface, at least, and over that on the surface as it is
ROUGH_MM, FALLEN = 1.0, 3.0  # median error of what may be improved, and how many times smaller it then is


@dataclass(frozen=True)
class Fit:
    """A depth map on a surface: the share of its strongest pixels that lie within NEAR_M of it, and the median of |Δz|
    of those that have any surface before them."""

    share: float
    median_mm: float

    @property
    def covers(self) -> bool:
        """True if most pixels lie on the surface: no other could have many times as many."""
        return GAINED * self.share >= 1

    @property
    def improvable(self) -> bool:
        """False if nothing undone could explain it much better."""
        return not self.covers or self.median_mm > ROUGH_MM

    def explains(self, as_is: "Fit") -> bool:
        """True if this, with a mistake undone, is so much better that the mistake is likely."""
        nearer = self.share > as_is.share and FALLEN * self.median_mm < as_is.median_mm > ROUGH_MM
        return self.share >= CERTAIN and (nearer or self.share >= GAINED * as_is.share)


def _diagonal(*values: float) -> np.ndarray:
    return np.diag([*values, 1.0])


# What undoes each mistake, in the radar's frame; "is" completes "the surface …" or "the antennas' positions are …".
UNDONE = {
    "mirrored in x": _diagonal(-1, 1, 1),
    "mirrored in y": _diagonal(1, -1, 1),
    "turned upside down": _diagonal(-1, -1, 1),
    "mirrored in z": _diagonal(1, 1, -1),
    "with x and y exchanged": np.eye(4)[[1, 0, 2, 3]],
    "in inches": _diagonal(*[0.0254] * 3),
    "in millimetres": _diagonal(*[1e-3] * 3),
    "in centimetres": _diagonal(*[1e-2] * 3),
    "ten times too large": _diagonal(*[0.1] * 3),
    "ten times too small": _diagonal(*[10.0] * 3),
}


def findings(depth: DepthMap, surface: Surface) -> list[str]:
    """The mistake, if any, without which a depth map lies much better on a surface (radar frame), with both errors."""
    as_is = fit(depth, surface)
    return best(depth, surface, as_is)[1] if as_is.improvable else []


def best(depth: DepthMap, surface: Surface, as_is: Fit) -> tuple[float, list[str]]:
    """The share of pixels on the surface without the mistake that explains most, and the sentence about it; share 0 and
    none where none does."""
    fits = {name: fit(depth, moved(surface, matrix)) for name, matrix in UNDONE.items()}
    name, found = max(fits.items(), key=lambda each: each[1].share)
    if not found.explains(as_is):
        return 0.0, []
    before = f"from {as_is.median_mm:.2f} to " if np.isfinite(as_is.median_mm) else "to "
    text = (
        f"the surface, or the antennas' positions, may be {name}: undone, the median error falls {before}"
        f"{found.median_mm:.2f} mm and {100 * found.share:.0f} % of the strongest pixels lie on the surface, not "
        f"{100 * as_is.share:.0f} %"
    )
    return found.share, [text]


def fit(depth: DepthMap, surface: Surface) -> Fit:
    """The fit of a depth map to a surface."""
    seen = np.flatnonzero(np.isfinite(depth.z_m))
    strongest = seen[np.argsort(-depth.amplitude_db.ravel()[seen], kind="stable")[:STRONGEST]]
    try:
        z_m = depth_on_grid(surface.mesh, depth.x_m, depth.y_m).ravel()[strongest]
    except HandbenchError:  # larger than anything before a radar
        return Fit(0.0, np.inf)
    off_m = np.abs(depth.z_m.ravel()[strongest] - z_m)
    met = off_m[np.isfinite(off_m)]
    return Fit(float((met < NEAR_M).sum() / max(len(off_m), 1)), float(1e3 * np.median(met)) if len(met) else np.inf)


def moved(surface: Surface, matrix: np.ndarray) -> Surface:
    """The surface where a matrix [3 or 4, 3 or 4] brings it, its normals outside."""
    vertices_m = surface.vertices_m @ matrix[:3, :3].T
    faces = surface.faces if np.linalg.det(matrix) > 0 else surface.faces[:, ::-1]
    return Surface(vertices_m, faces, surface.sigma_m, surface.observed)
