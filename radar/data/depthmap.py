"""Depth maps: the output of every method and the input of scoring."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from handbench.support.errors import HandbenchError
from handbench.support.files import plain_json, read_npz, write_npz

LIMIT = "velocity_limit_m_s"
LARGEST = 1e6  # in a depth map; larger numbers are no metres, and in float32 soon infinite
FLAGGED = 0.5  # p_gross above which a pixel is likelier wrong than right
# maps [ny, nx] of a depth map, with the smallest and the largest possible value
RANGES = {
    "z_m": (-LARGEST, LARGEST),
    "amplitude_db": (-np.inf, LARGEST),
    "sigma_m": (0.0, np.inf),
    "wrapped": (0, 1),
    "p_gross": (0.0, 1.0),
    "velocity_m_s": (-LARGEST, LARGEST),
    "velocity_sigma_m_s": (0.0, np.inf),
}


@dataclass(frozen=True)
class DepthMap:
    """A depth map, the output of every method, on pixels at x_m [nx] × y_m [ny], metres.

    z_m [ny, nx]: depths, NaN off target; amplitude_db [ny, nx]: 0 at the maximum; method, config:
    id and configuration of the method.

    Optional fields [ny, nx]: sigma_m: standard deviation (1σ) of z_m where it is not wrapped, NaN
    off target. wrapped, bool: True where the true depth may be outside the range in which the
    method looks: a period off, or beyond an end of the volume. p_gross: probability that z_m is
    more than 5 mm from the nearest true surface (`radar.methods.gross_errors`), NaN off target.
    velocity_m_s, velocity_sigma_m_s: radial velocity, positive away from the array, and its
    standard deviation (1σ), NaN off target.

    velocity_limit_m_s: largest velocity that the measurement can tell, one number; beyond it the
    velocity is off by a multiple of twice this limit.
    """

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    amplitude_db: np.ndarray
    method: str
    config: dict[str, Any] = field(default_factory=dict)
    sigma_m: np.ndarray | None = None
    wrapped: np.ndarray | None = None
    p_gross: np.ndarray | None = None
    velocity_m_s: np.ndarray | None = None
    velocity_sigma_m_s: np.ndarray | None = None
    velocity_limit_m_s: float | None = None

    def checked(self, where: str | Path) -> "DepthMap":
        """Return the map if it is valid. Raises HandbenchError for arrays whose shapes or types do
        not fit the axes, axes that are not sorted, infinite or absurd lengths, and values that are
        impossible for a field, such as a negative standard deviation.

        where: file or argument of the map, with which the message begins.
        """
        maps = {name: getattr(self, name) for name in RANGES if getattr(self, name) is not None}
        shape = self.y_m.size, self.x_m.size
        shapes = {"x_m": shape[1:], "y_m": shape[:1]} | dict.fromkeys(maps, shape)
        for name, expected in shapes.items():
            values, flags = getattr(self, name), name == "wrapped"
            if values.shape != expected or values.dtype.kind != ("b" if flags else "f"):
                kind = "bool" if flags else "floats (lengths in metres, NaN without a depth)"
                raise HandbenchError(
                    f"{where}: {name} is {values.dtype} {values.shape}; expected {kind} of shape "
                    f"{expected}, the numbers of y_m and x_m; make the file again"
                )
        for name in ("x_m", "y_m"):
            axis_m = getattr(self, name)
            sorted_ = (axis_m[1:] > axis_m[:-1]).all() or (axis_m[1:] < axis_m[:-1]).all()
            if not (axis_m.size and sorted_ and (np.abs(axis_m) <= LARGEST).all()):
                raise HandbenchError(
                    f"{where}: {name} is empty or not sorted, or has equal or infinite values; "
                    f"expected the centres of the pixels in metres, in order, at most {LARGEST:g} "
                    "m from 0"
                )
        if (limit := self.velocity_limit_m_s) is not None and not 0 < limit < np.inf:
            raise HandbenchError(
                f"{where}: {LIMIT} is {limit:g}; expected a number of metres per second above 0; "
                "make the file again"
            )
        for name, values in maps.items():
            least, most = np.array(RANGES[name])  # as float64, which a float16 is compared in
            wrong = (values < least) | (values > most)
            if name == "amplitude_db":
                wrong |= np.isnan(values) & ~np.isnan(self.z_m)
            if wrong.any():
                raise HandbenchError(
                    f"{where}: {name} is {values[wrong][0]:g} at {wrong.sum()} of {wrong.size} "
                    f"pixels (first value); expected numbers from {least:g} to {most:g}, or NaN "
                    "where there is no depth; make the file again"
                )
        return self

    @property
    def doubtful(self) -> np.ndarray:
        """Where a depth is in doubt [ny, nx]: its method flags it, or p_gross exceeds FLAGGED."""
        doubtful = np.zeros(self.z_m.shape, bool)
        if self.wrapped is not None:
            doubtful |= self.wrapped
        if self.p_gross is not None:
            doubtful |= self.p_gross > FLAGGED
        return doubtful & np.isfinite(self.z_m)

    def without_depths(self) -> "DepthMap":
        """Return the map of a frame in which nothing is observed, on the same pixels."""
        nothing = np.full_like(self.z_m, np.nan)
        velocity: dict[str, Any] = {} if self.velocity_m_s is None else {"velocity_m_s": nothing}
        return replace(self, z_m=nothing, **velocity)

    def save(self, path: str | Path) -> None:
        """Write the depth map to an .npz file, atomically; `load_depthmap` reads it."""
        known = {name: value for name, value in vars(self).items() if value is not None}
        write_npz(path, **known | {"config": json.dumps(self.config)})


def load_depthmap(path: str | Path) -> DepthMap:
    """Read a depth map from its .npz file; a map without a method is named after the file. Raises
    HandbenchError for a file that is no depth map, and for invalid arrays (`DepthMap.checked`)."""
    required, optional = ("x_m", "y_m", "z_m", "amplitude_db"), ("method", "config", *RANGES, LIMIT)
    content: dict[str, Any] = read_npz(path, required, optional)
    try:
        content["config"] = plain_json(str(content.get("config", "{}")))
    except ValueError as error:
        raise HandbenchError(
            f"{path}: config is not JSON ({error}), but should be the settings of the method; "
            "make the file again"
        ) from None
    if LIMIT in content:
        content[LIMIT] = _one_number(path, content[LIMIT])
    content["method"] = str(content.get("method", Path(path).stem))
    return DepthMap(**content).checked(path)


def _one_number(path: str | Path, values: np.ndarray) -> float:
    if values.shape != () or values.dtype.kind not in "iuf":
        raise HandbenchError(
            f"{path}: {LIMIT} is {values.dtype} of shape {values.shape}; expected one number; make "
            "the file again"
        )
    return float(values)


def amplitude_db(amplitude: np.ndarray) -> np.ndarray:
    """Convert amplitudes to dB relative to their maximum, 20 log10: float32, −inf for amplitude 0.
    Raises HandbenchError if all amplitudes are zero."""
    peak = amplitude.max(initial=0.0)
    if not peak > 0:
        raise HandbenchError(
            "echoes: the image is zero everywhere; use a capture whose echoes are not all zero"
        )
    ratio, db = amplitude / peak, np.full(amplitude.shape, -np.inf, np.float32)
    np.log10(ratio, out=db, where=ratio > 0)
    return 20 * db
