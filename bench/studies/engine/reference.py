"""Exact images with which the benchmark compares fast ones: at random voxels of a volume, and at
all voxels along z of random pixels.

Errors are relative to the root mean square of the whole volume, so that errors at random voxels
represent the whole volume.
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

    voxels [n], pixels [p]: flat indices of the checked voxels and pixels, chosen at random. exact:
    complex image [n] at the voxels, by source of the echoes ("hand" or "noise"). rms: root mean
    square of the whole image, by source. direct [d]: float64 sums over the hand's echoes at the
    first d voxels. columns: peaks along z at the pixels, from exact images. mask [ny, nx]: pixels
    on the target.
    """

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
        """Compute the root mean square error of an image at the checked voxels, relative to the
        root mean square of the whole exact image.

        values [≤ n]: the image at the first checked voxels. source: of its echoes, "hand" or
        "noise". exact: values to compare with (None: the exact image of that source).
        """
        exact = self.exact[source] if exact is None else exact
        known = min(len(values), len(exact))
        difference = values[:known].astype(np.complex128) - exact[:known]
        return float(np.sqrt(np.mean(np.abs(difference) ** 2)) / self.rms[source])

    def deviation(self, peaks: Peaks) -> Record:
        """Compare the peaks along z of a whole volume with the exact ones. Returns the mean depth
        deviation at the checked pixels in mm, and the number of pixels that only one of the two
        volumes counts as target."""
        index, magnitude = peaks.index.ravel(), peaks.magnitude.reshape(3, -1)
        checked = Peaks(index[self.pixels], magnitude[:, self.pixels])
        mask = amplitude_db(peaks.magnitude[1]) >= self.threshold_db
        return {
            "depth_deviation_mm": self.deviation_mm(checked),
            "mask_difference_px": int(np.count_nonzero(mask != self.mask)),
        }

    def deviation_mm(self, checked: Peaks) -> float:
        """Compute the mean |Δz|, mm, between the given peaks at the checked pixels [p] and the
        exact ones. Depths are interpolated between voxels."""
        off_m = self._depths_m(checked) - self._depths_m(self.columns)
        return 1e3 * float(np.abs(off_m).mean())

    def _depths_m(self, peaks: Peaks) -> np.ndarray:
        step_m = np.diff(self.grid.z_m)[0]
        return np.asarray(self.grid.z_m[peaks.index] + step_m * peak_offset(peaks.magnitude))


def reference(inputs: Inputs) -> EngineReference:
    """Choose random voxels and pixels to check, and compute the exact images there."""
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
    """Return the centres [nz · p, 3], metres, of all voxels along z at p pixels, layer by layer.
    pixels [p]: flat indices."""
    layer = np.prod(grid.shape[1:])
    return grid.points_at_m((np.arange(grid.shape[0])[:, None] * layer + pixels).ravel())


def column_peaks(images: np.ndarray, grid: VoxelGrid) -> Peaks:
    """Find the strongest voxel along z at each of p pixels. images [nz · p]: complex image at all
    voxels of these pixels, all pixels of the first layer first."""
    peaks = strongest_voxels(images.astype(np.complex64).reshape(len(grid.z_m), 1, -1))
    return Peaks(peaks.index[0], peaks.magnitude[:, 0])
