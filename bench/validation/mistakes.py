"""Detection of mistakes that images show: conjugated echoes and, if the true surface is known,
wrong frames and lengths.

For conjugation, a coarse image is made of the echoes as they are, and one of their conjugates. The
sharper one is taken as right, by Σ|I|⁴ / (Σ|I|²)² (Muller & Buffington, J. Opt. Soc. Am. 64 (1974)
1200). Sharpness does not show a mirrored array, exchanged axes or antennas, or a wrong length; it
shows tones in reverse order only if there are no echoes from outside the image.

A surface shows these: it is mirrored, its axes are exchanged, or its unit is changed, and the
pixels of a depth map that are then on it are counted. The mistake may be in the surface or in the
antennas' positions; their difference does not show in which.
"""

from dataclasses import dataclass, replace

import numpy as np

from handbench.bench.validation.checks import places_m, warnings_of
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import VoxelGrid
from handbench.support.errors import HandbenchError

# at most, of a kind and of a scan: more do not change which is sharpest
ANTENNAS, POSITIONS, TONES = (32, 400, 32)
# an array deeper than this share of its width may surround its target; no conjugation is checked
SHALLOW = 0.3
# the box imaged, in apertures: to either side, and along z from and to
WIDE, NEAR, FAR = (0.85, 1.0, 8.0)
CELL, DEEP = 2.0, 8.0  # resolution cell and depth of focus two apertures away, in wavelengths
NEAR_M = 3e-3  # a pixel that close is on the surface
STRONGEST = 1500  # pixels that are looked at, at most: those that shine most
# share of pixels on the undone surface, at least, and over that on the surface as it is
CERTAIN, GAINED = (0.3, 1.5)
# median error of what may be improved, and how many times smaller it then is
ROUGH_MM, FALLEN = (1.0, 3.0)


def conjugation_warnings(capture: RadarCapture) -> list[str]:
    """Return a list with a warning if the echoes of the first frame focus better when they are
    conjugated; else an empty list. Arrays that may surround the target are not checked."""
    *across_m, deep_m = np.ptp(places_m(capture), axis=0)
    if not capture.samples[0].any() or deep_m > SHALLOW * max(across_m):
        return []
    sharper_db = sharpness_db(replace(capture, samples=capture.samples.conj())) - sharpness_db(
        capture
    )
    return list(warnings_of("echoes", {"sharper_db": sharper_db, "within_m": FAR * max(across_m)}))


def sharpness_db(capture: RadarCapture) -> float:
    """Compute the sharpness of a coarse image I of a capture's first frame, in dB: Σ|I|⁴ /
    (Σ|I|²)²."""
    # compiled, which comparing a map with a surface does not need
    from handbench.radar.imaging.api import image_volume

    few = _reduced(capture)
    # a plan takes longer
    samples = scaled_to_one(few.samples[0])
    volume = image_volume(samples, few.frequencies_hz, few.aperture, _box(few), None)
    power = np.abs(volume).astype(np.float64) ** 2
    return float(10 * np.log10((power**2).sum() / power.sum() ** 2))


def _reduced(capture: RadarCapture) -> RadarCapture:
    """Return the capture with only its first frame, a few tones in rising order, and a few antennas
    of measured pairs. Frequencies are converted to those with the same wavelengths in vacuum."""
    order = np.argsort(capture.frequencies_hz, kind="stable")
    tones, array = order[even_subset(len(order), TONES)], capture.aperture
    samples, frequencies_hz = capture.samples[:1, tones], capture.frequencies_hz[tones]
    if isinstance(array, AntennaArray):
        measured = np.ones(array.channels, bool) if array.measured is None else array.measured
        t, r = (np.flatnonzero(measured.any(axis=axis)) for axis in (1, 0))
        t, r = t[even_subset(len(t), ANTENNAS)], r[even_subset(len(r), ANTENNAS)]
        samples, places = (
            samples[:, :, t[:, None], r],
            {"tx_m": array.tx_m[t], "rx_m": array.rx_m[r], "measured": None},
        )
    else:  # at random: every n-th of a raster may be one column
        number = array.channels[0]
        some = np.sort(
            np.random.default_rng(0).choice(number, min(number, POSITIONS), replace=False)
        )
        samples, places = (
            samples[:, :, some],
            {name: places_m[some] for name, places_m in vars(array).items()},
        )
    slower = SPEED_OF_LIGHT_M_S / capture.wave_speed_m_s
    return RadarCapture(
        np.ascontiguousarray(samples), frequencies_hz * slower, replace(array, **places)
    )


def _box(capture: RadarCapture) -> VoxelGrid:
    """Return coarse voxels in front of the aperture, in a volume large enough for the image of any
    near target."""
    places = places_m(capture)
    middle_m, size_m = (
        (places.min(axis=0) + places.max(axis=0)) / 2,
        float(np.ptp(places, axis=0).max()),
    )
    length_m = SPEED_OF_LIGHT_M_S / capture.frequencies_hz.mean()
    cell_m = SPEED_OF_LIGHT_M_S / 2 / max(float(np.ptp(capture.frequencies_hz)), 1.0)
    deep_m, wide_m = min(DEEP * length_m, 0.8 * cell_m), max(WIDE * size_m, length_m)
    across_m = np.arange(-wide_m, wide_m, max(CELL * length_m, wide_m / 40))
    far_m = max(FAR * size_m, 2 * deep_m)
    along_m = np.arange(NEAR * size_m, far_m, max(deep_m, far_m / 100))
    return VoxelGrid(middle_m[0] + across_m, middle_m[1] + across_m, middle_m[2] + along_m)


@dataclass(frozen=True)
class SurfaceFit:
    """How well a depth map agrees with a surface.

    share: share of the map's strongest pixels that are within NEAR_M of the surface. median_mm:
    median |Δz| of those strongest pixels whose ray meets the surface.
    """

    share: float
    median_mm: float

    @property
    def covers(self) -> bool:
        """True if so many pixels are on the surface that no correction could increase their number
        much."""
        return GAINED * self.share >= 1

    @property
    def improvable(self) -> bool:
        """True if a correction could bring many more pixels onto the surface, or lower the median
        error much."""
        return not self.covers or self.median_mm > ROUGH_MM

    def explains(self, as_is: "SurfaceFit") -> bool:
        """Return True if this fit, after the correction of a mistake, is so much better than the
        fit without it (as_is) that the mistake is likely."""
        nearer = self.share > as_is.share and FALLEN * self.median_mm < as_is.median_mm > ROUGH_MM
        return self.share >= CERTAIN and (nearer or self.share >= GAINED * as_is.share)


def _diagonal(*values: float) -> np.ndarray:
    return np.diag([*values, 1.0])


# What undoes each mistake, in the radar's frame; "is" completes "the surface …" or "the antennas'
# positions are …".
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


def misplacement_warnings(depth: DepthMap, surface: Surface) -> list[str]:
    """Return a list with a warning if a surface (radar frame) fits a depth map much better after it
    is mirrored, turned or scaled; else an empty list. The warning names the likely mistake and both
    errors."""
    as_is = fit(depth, surface)
    return best(depth, surface, as_is)[1] if as_is.improvable else []


def best(depth: DepthMap, surface: Surface, as_is: SurfaceFit) -> tuple[float, list[str]]:
    """Find the correction of the surface (mirroring, turning or scaling) with which it fits the
    depth map best: (share of pixels that are then on the surface, list with a sentence about the
    mistake).

    as_is: the fit without correction. If no correction helps enough, the result is 0 and an empty
    list.
    """
    fits = {name: fit(depth, moved(surface, matrix)) for name, matrix in UNDONE.items()}
    name, found = max(fits.items(), key=lambda each: each[1].share)
    if not found.explains(as_is):
        return 0.0, []
    before = f"from {as_is.median_mm:.2f} to " if np.isfinite(as_is.median_mm) else "to "
    text = (
        f"the surface or the antennas' positions may be {name}; after correcting this, the median "
        f"error falls {before}{found.median_mm:.2f} mm, and {100 * found.share:.0f} % of the "
        f"strongest pixels are on the surface, not {100 * as_is.share:.0f} %"
    )
    return found.share, [text]


def fit(depth: DepthMap, surface: Surface) -> SurfaceFit:
    """Compute how well the strongest pixels of a depth map agree with a surface in the radar
    frame."""
    seen = np.flatnonzero(np.isfinite(depth.z_m))
    strongest = seen[np.argsort(-depth.amplitude_db.ravel()[seen], kind="stable")[:STRONGEST]]
    try:
        z_m = depth_on_grid(surface.mesh, depth.x_m, depth.y_m).ravel()[strongest]
    except HandbenchError:  # larger than anything before a radar
        return SurfaceFit(0.0, np.inf)
    off_m = np.abs(depth.z_m.ravel()[strongest] - z_m)
    met = off_m[np.isfinite(off_m)]
    return SurfaceFit(
        float((met < NEAR_M).sum() / max(len(off_m), 1)),
        float(1e3 * np.median(met)) if len(met) else np.inf,
    )


def moved(surface: Surface, matrix: np.ndarray) -> Surface:
    """Return the surface transformed by the linear part of a matrix, 3×3 or 4×4; a translation is
    ignored. Normals stay outward, also after a reflection."""
    vertices_m = surface.vertices_m @ matrix[:3, :3].T
    faces = surface.faces if np.linalg.det(matrix) > 0 else surface.faces[:, ::-1]
    return Surface(vertices_m, faces, surface.sigma_m, surface.observed)
