"""The exact images that every row's error is taken against: random voxels, and whole columns of
random pixels.

Errors are relative to the whole volume's root mean square, so that random voxels speak for the
whole volume.
"""

from dataclasses import dataclass

import numpy as np

from handbench.bench.studies.engine.scope import Inputs
from handbench.bench.studies.engine.textbook import numpy_sum
from handbench.bench.studies.study import Record
from handbench.radar.data.depthmap import amplitude_db
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume
from handbench.radar.imaging.cpu.exact import exact_images
from handbench.radar.imaging.peaks import Peaks, strongest_voxels
from handbench.radar.methods.projection import peak_offset

STAND_IN = 1e-6  # tolerance of the volume that gives the mask and the root mean square


@dataclass(frozen=True)
class EngineReference:
    """The exact values with which every fast image is compared.
    voxels [n], pixels [p]: flat indices of what is checked, chosen at random. exact: "hand" or
    "noise" → exact image [n] at the voxels, from all tones. rms: the same → root mean square of the
    whole image. direct [d]: float64 sums of the hand's echoes at the first d voxels. columns: peaks
    along z at the checked pixels, from exact images. mask [ny, nx]: pixels on target."""

    grid: VoxelGrid
    threshold_db: float
    voxels: np.ndarray
    exact: dict[str, np.ndarray]
    rms: dict[str, float]
    direct: np.ndarray
    pixels: np.ndarray
    columns: Peaks
    mask: np.ndarray

    def error(
        self, values: np.ndarray, source: str = "hand", exact: np.ndarray | None = None
    ) -> float:
        """Compute an image's relative L2 error at the checked voxels, relative to the whole image's
        root mean square.
        values [≤ n]: the image at the first checked voxels. source: "hand" or "noise". exact: other
        values to compare with."""
        exact = self.exact[source] if exact is None else exact
        known = min(len(values), len(exact))
        difference = values[:known].astype(np.complex128) - exact[:known]
        return float(np.sqrt(np.mean(np.abs(difference) ** 2)) / self.rms[source])

    def deviation(self, peaks: Peaks) -> Record:
        """Compare the peaks of a whole volume with the exact ones: mean depth deviation at the
        checked pixels, mm, and the number of pixels that are on target in only one of both."""
        index, magnitude = peaks.index.ravel(), peaks.magnitude.reshape(3, -1)
        checked = Peaks(index[self.pixels], magnitude[:, self.pixels])
        mask = amplitude_db(peaks.magnitude[1]) >= self.threshold_db
        return {
            "depth_deviation_mm": self.deviation_mm(checked),
            "mask_difference_px": int(np.count_nonzero(mask != self.mask)),
        }

    def deviation_mm(self, checked: Peaks) -> float:
        """Compute the mean |Δz|, mm, between the peaks at the checked pixels [p] and the exact
        ones, with depths interpolated between voxels."""
        off_m = self._depths_m(checked) - self._depths_m(self.columns)
        return 1e3 * float(np.abs(off_m).mean())

    def _depths_m(self, peaks: Peaks) -> np.ndarray:
        step_m = np.diff(self.grid.z_m)[0]
        return np.asarray(self.grid.z_m[peaks.index] + step_m * peak_offset(peaks.magnitude))


def reference(inputs: Inputs) -> EngineReference:
    """Choose the voxels and pixels that are checked, and compute their exact images."""
    scope, grid, array, tones_hz = inputs.scope, inputs.grid, inputs.array, inputs.tones_hz
    random, threshold_db = np.random.default_rng(0), scope.config.threshold_db
    voxels = random.choice(int(np.prod(grid.shape)), scope.checked_voxels, replace=False)
    points_m, hand = grid.points_at_m(voxels), inputs.samples["hand"]

    def exactly(samples: np.ndarray, points_m: np.ndarray) -> np.ndarray:
        return exact_images(samples, tones_hz, array, points_m, apart=False)[0]

    exact, rms, stand_in = {}, {}, {}
    for source, samples in inputs.samples.items():
        exact[source] = exactly(samples, points_m)
        stand_in[source] = image_volume(samples, tones_hz, array, grid, STAND_IN)
        rms[source] = float(np.sqrt(np.mean(np.abs(stand_in[source]) ** 2, dtype=np.float64)))
    mask = amplitude_db(strongest_voxels(stand_in["hand"]).magnitude[1]) >= threshold_db
    on_target = np.flatnonzero(mask)
    count = min(scope.checked_pixels, len(on_target))
    pixels = random.choice(on_target, count, replace=False)
    columns = exactly(hand, column_points_m(grid, pixels))
    return EngineReference(
        grid=grid,
        threshold_db=threshold_db,
        voxels=voxels,
        exact=exact,
        rms=rms,
        direct=numpy_sum(hand, tones_hz, array, points_m[: scope.numpy_voxels]),
        pixels=pixels,
        columns=column_peaks(columns, grid),
        mask=mask,
    )


def column_points_m(grid: VoxelGrid, pixels: np.ndarray) -> np.ndarray:
    """Return the centres [nz · p, 3], metres, of all voxels in the columns along z of pixels with
    these flat indices [p]."""
    layer = np.prod(grid.shape[1:])
    return grid.points_at_m((np.arange(grid.shape[0])[:, None] * layer + pixels).ravel())


def column_peaks(images: np.ndarray, grid: VoxelGrid) -> Peaks:
    """Find the peaks along z of images [nz · p] at the points of `column_points_m`: one for each of
    the p pixels."""
    peaks = strongest_voxels(images.astype(np.complex64).reshape(len(grid.z_m), 1, -1))
    return Peaks(peaks.index[0], peaks.magnitude[:, 0])
