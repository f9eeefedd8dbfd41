"""A bitmap as a target's skin: facets that face the same way share a chart of it."""

from dataclasses import dataclass

import numpy as np

from handbench.groundtruth.mesh.mesh_files import mesh, raycasting_scene
from handbench.support.rays import load_open3d

TEXEL_M = 1e-4
MOST_ROWS = 1 << 14  # cv2.remap refuses maps longer than 2^15
MARGIN = 2  # texels around a chart, for the interpolation at its border
COARSEST_M = 8e-3  # of the pattern
CONTRAST = 0.16  # standard deviation of the reflectance's logarithm
SKIN_RGB = (0.60, 0.38, 0.28)  # linear reflectances


@dataclass(frozen=True)
class Atlas:
    """A bitmap [rows, columns, 3] of linear reflectances on a closed mesh, vertices [n, 3] in
    metres, faces [m, 3].

    A facet's chart is that of the axis which its normal is nearest to, of six: the other two
    coordinates, in texels of TEXEL_M from chart_origin [6, 2], are the bitmap's columns and rows
    (the first texel's centre is at 0.5).
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    bitmap: np.ndarray
    chart: np.ndarray
    chart_origin: np.ndarray

    @classmethod
    def of(cls, vertices_m: np.ndarray, faces: np.ndarray, seed: int) -> "Atlas":
        """A mesh's charts, one below the other, with a random pattern whose amplitude falls with
        its frequency."""
        corners = vertices_m[faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        axis = np.abs(normal).argmax(axis=1)
        chart = 2 * axis + (np.take_along_axis(normal, axis[:, None], 1)[:, 0] > 0)
        low, size = (
            vertices_m.min(axis=0),
            np.ceil(np.ptp(vertices_m, axis=0) / TEXEL_M).astype(int) + 2 * MARGIN,
        )
        heights = np.array([size[_across(k)[1]] for k in range(6)])
        tops = np.concatenate([[0], np.cumsum(heights)])
        origin = np.stack(
            [low[list(_across(k))] / TEXEL_M - (MARGIN, MARGIN + tops[k]) for k in range(6)]
        )
        shade = _pattern((int(tops[-1]), int(size.max())), seed)
        bitmap = np.array(SKIN_RGB, dtype=np.float32) * np.exp(CONTRAST * shade)[..., None]
        return cls(vertices_m, faces, np.minimum(bitmap, 0.95), chart, origin)

    def corner_texels(self) -> np.ndarray:
        """Columns and rows [m, 3, 2] of the facets' corners."""
        return self._texels(self.vertices_m[self.faces], self.chart[:, None])

    def reflectance(self, points_m: np.ndarray) -> np.ndarray:
        """Reflectance [n, 3] at points [n, 3] on the mesh, cubic between texels."""
        import cv2

        scene = raycasting_scene(mesh(self.vertices_m, self.faces))
        nearest = scene.compute_closest_points(
            load_open3d().core.Tensor(points_m.astype(np.float32))
        )
        column, row = (
            (self._texels(points_m, self.chart[nearest["primitive_ids"].numpy()]) - 0.5)
            .astype(np.float32)
            .T
        )
        result = np.empty((len(points_m), 3), dtype=np.float32)
        for first in range(0, len(result), MOST_ROWS):
            part = slice(first, first + MOST_ROWS)
            result[part] = cv2.remap(
                self.bitmap, column[part, None], row[part, None], cv2.INTER_CUBIC
            )[:, 0]
        return result

    def _texels(self, points_m: np.ndarray, chart: np.ndarray) -> np.ndarray:
        """Columns and rows [..., 2] of points [..., 3] in a chart [...]."""
        across = np.array([_across(k) for k in range(6)])[
            np.broadcast_to(chart, points_m.shape[:-1])
        ]
        return np.take_along_axis(points_m, across, -1) / TEXEL_M - self.chart_origin[chart]


def _across(chart: int) -> tuple[int, int]:
    """The axes of a chart's columns and rows."""
    first, second = (axis for axis in range(3) if axis != chart // 2)
    return first, second


def _pattern(shape: tuple[int, int], seed: int) -> np.ndarray:
    """Random values [rows, columns] of zero mean and unit variance: amplitudes fall as 1/f beyond
    COARSEST_M."""
    spectrum = np.fft.rfft2(np.random.default_rng([seed, 7]).standard_normal(shape))
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])) / TEXEL_M
    values = np.fft.irfft2(spectrum / np.maximum(frequency, 1 / COARSEST_M), shape)
    return ((values - values.mean()) / values.std()).astype(np.float32)
