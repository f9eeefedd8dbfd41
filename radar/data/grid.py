"""Regular axes: tones, and pixel and voxel grids in the radar frame, metres."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from handbench.radar.data.arrays import positions
from handbench.support.config import Config, Near, Tone
from handbench.support.errors import HandbenchError

MOST_ON_AXIS = 2_000  # samples, which take up to 20 s and 0.2 GB to plan


class Sweep(Config):
    """`count` evenly spaced tones from start_hz to stop_hz, both included."""

    start_hz: Tone = 72e9
    stop_hz: Tone = 82e9
    count: int = Field(default=128, ge=1, le=100_000)

    @property
    def frequencies_hz(self) -> np.ndarray:
        """The tones [count], hertz."""
        return np.linspace(self.start_hz, self.stop_hz, self.count)


class Axis(Config):
    """Evenly spaced coordinates from start_m to stop_m with the step step_m, metres. Raises
    ValueError for an axis that is not ascending, is shorter than its step, or has too many
    samples."""

    start_m: Near
    stop_m: Near
    step_m: float = Field(gt=0)

    @model_validator(mode="after")
    def _ascending(self) -> "Axis":
        if self.stop_m < self.start_m:
            raise ValueError("stop_m is smaller than start_m; exchange the two")
        return self

    @model_validator(mode="after")
    def _bounded(self) -> "Axis":
        if self.count > MOST_ON_AXIS:
            raise ValueError(
                f"step_m = {self.step_m:g} makes {self.count:.4g} points on this axis, more than "
                f"{MOST_ON_AXIS}; take a larger step_m"
            )
        if 0 < self.stop_m - self.start_m < self.step_m:
            raise ValueError(
                f"step_m = {self.step_m:g} is longer than the axis, stop_m − start_m; if it is in "
                "millimetres, multiply it by 0.001"
            )
        return self

    @property
    def count(self) -> int:
        """Number of samples."""
        return int(np.floor((self.stop_m - self.start_m) / self.step_m + 1e-6)) + 1

    def values_m(self) -> np.ndarray:
        """Return the coordinates [count], metres, from start_m on. stop_m is the last one if the
        step divides the range; else the last one is before it."""
        # −0.098, not −0.09799999999999999
        return np.round(self.start_m + self.step_m * np.arange(self.count), 12)


@dataclass(frozen=True)
class PixelGrid:
    """Pixels at x_m [nx] × y_m [ny], metres; images are stored [ny, nx], y growing with the row."""

    x_m: np.ndarray
    y_m: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of an image: (ny, nx)."""
        return len(self.y_m), len(self.x_m)

    def points_at_m(self, index: np.ndarray, z_m: np.ndarray | float) -> np.ndarray:
        """Return the points [n, 3] of the pixels with flat indices [n], metres, at one common depth
        z_m or a depth each [n]."""
        y, x = np.unravel_index(index, self.shape)
        return np.stack([self.x_m[x], self.y_m[y], np.broadcast_to(z_m, len(x))], axis=1)

    def on_map(
        self, index: np.ndarray, values: np.ndarray | float, elsewhere: float = np.nan
    ) -> np.ndarray:
        """Return a map [ny, nx] (float64) that has `values` [n] at the pixels with flat indices
        index [n], and the value `elsewhere` at all others."""
        whole = np.full(self.shape, elsewhere)
        whole.ravel()[index] = values
        return whole

    def points_m(self, z_m: np.ndarray | float) -> np.ndarray:
        """Return the points [ny, nx, 3] of all pixels, metres, at one common depth z_m or at depths
        [ny, nx]."""
        x, y = np.meshgrid(self.x_m, self.y_m)
        return np.stack([x, y, np.broadcast_to(z_m, x.shape)], axis=-1)


@dataclass(frozen=True)
class VoxelGrid:
    """Voxels at x_m [nx] × y_m [ny] × z_m [nz], metres, each ascending, evenly spaced or not.
    Volumes are stored as [nz, ny, nx]. Raises HandbenchError for axes that do not ascend, and for
    coordinates too far away for phases in float64."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray

    def __post_init__(self) -> None:
        for name, axis in (("x_m", self.x_m), ("y_m", self.y_m), ("z_m", self.z_m)):
            if np.ndim(axis) != 1 or len(axis) == 0 or not (axis[1:] >= axis[:-1]).all():
                raise HandbenchError(
                    f"{name}: is not an ascending axis of shape [n]; sort it, and the volume in "
                    "the same order"
                )
        positions("x_m, y_m or z_m", self.ends_m)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of a volume: (nz, ny, nx)."""
        return len(self.z_m), len(self.y_m), len(self.x_m)

    @property
    def ends_m(self) -> tuple[np.ndarray, np.ndarray]:
        """First and last voxel centre, each [x, y, z], metres."""
        first, last = (
            np.array([axis[i] for axis in (self.x_m, self.y_m, self.z_m)]) for i in (0, -1)
        )
        return first, last

    def points_at_m(self, index: np.ndarray) -> np.ndarray:
        """Return the centres [n, 3] of the voxels with flat indices [n], metres."""
        z, y, x = np.unravel_index(index, self.shape)
        return np.stack([self.x_m[x], self.y_m[y], self.z_m[z]], axis=1)

    def points_m(self) -> np.ndarray:
        """Return the centres of all voxels: [nz, ny, nx, 3], metres."""
        z, y, x = np.meshgrid(self.z_m, self.y_m, self.x_m, indexing="ij")
        return np.stack([x, y, z], axis=-1)


def bounding_box(mask: np.ndarray) -> tuple[slice, slice]:
    """Return the smallest rectangle that contains every True pixel of a mask [ny, nx]: (slice of
    rows, slice of columns)."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
