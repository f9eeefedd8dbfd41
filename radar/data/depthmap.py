"""Depth maps: the output of every method and the input of scoring."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from handbench.support.errors import HandbenchError
from handbench.support.files import read_npz, write_npz

# fields that only some methods fill in, with their kind of number
OPTIONAL = {"sigma_m": "f", "wrapped": "b", "p_gross": "f"}
FLAGGED = 0.5  # p_gross above which a pixel counts as flagged


@dataclass(frozen=True)
class DepthMap:
    """A depth map, the output of every method, on pixels at x_m [nx] × y_m [ny], metres.

    z_m [ny, nx]: depths, NaN off target; amplitude_db [ny, nx]: 0 at the maximum; method, config:
    id and configuration of the method. Optional fields [ny, nx]: sigma_m: predicted standard
    deviation (1σ) of z_m if no phase has wrapped, NaN off target. wrapped, bool: flagged pixels,
    whose phase may have wrapped (z_m is then off by a whole period), whose tones disagree on the
    depth, or whose depth is the first or the last one searched. p_gross: probability that z_m is
    more than 5 mm from the nearest true surface (`radar.methods.depth_uncertainty`), NaN off
    target.
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

    def trusted(self, most: float) -> "DepthMap":
        """Return the map with depths NaN where p_gross, the probability of a gross error, exceeds
        `most` (0 to 1) or is unknown. Raises HandbenchError for a map without p_gross and for
        `most` outside 0 to 1."""
        if self.p_gross is None or not 0 <= most <= 1:
            has = (
                "the depth map has no p_gross"
                if self.p_gross is None
                else f"p_gross: is to be at most {most:g}"
            )
            raise HandbenchError(
                f"{has}; expected one from handbench reconstruct, and a probability from 0 to 1"
            )
        keep = np.isfinite(self.z_m) & (self.p_gross <= most)
        return replace(self, z_m=np.where(keep, self.z_m, np.nan))

    def save(self, path: str | Path) -> None:
        """Write the depth map to an .npz file, atomically; `load_depthmap` reads it."""
        known = {name: value for name, value in vars(self).items() if value is not None}
        write_npz(path, **known | {"config": json.dumps(self.config)})


def load_depthmap(path: str | Path) -> DepthMap:
    """Read a depth map from its .npz file. Raises HandbenchError for a file that is none, and for
    arrays whose shapes or types do not fit the axes."""
    content: dict[str, Any] = read_npz(
        path, ("x_m", "y_m", "z_m", "amplitude_db", "method", "config"), tuple(OPTIONAL)
    )
    known = [name for name in OPTIONAL if name in content]
    shape = content["y_m"].size, content["x_m"].size
    shapes = {
        "x_m": shape[1:],
        "y_m": shape[:1],
        "z_m": shape,
        "amplitude_db": shape,
    } | dict.fromkeys(known, shape)
    for name, expected in shapes.items():
        kind = OPTIONAL.get(name, "f")
        if content[name].shape != expected or content[name].dtype.kind != kind:
            found = f"{content[name].dtype} {content[name].shape}"
            numbers = "real numbers" if kind == "f" else "bool"
            raise HandbenchError(
                f"{path}: {name} is {found}; expected {numbers} {expected} from y_m, x_m"
            )
    try:
        content["config"] = json.loads(str(content["config"]))
    except ValueError as error:
        raise HandbenchError(
            f"{path}: config is not JSON ({error}); expected the method's configuration"
        ) from None
    return DepthMap(**content | {"method": str(content["method"])})


def amplitude_db(amplitude: np.ndarray) -> np.ndarray:
    """Convert amplitudes to dB relative to their maximum, 20 log10: float32, −inf for 0. Raises
    HandbenchError for an image of zeros."""
    peak = amplitude.max(initial=0.0)
    if not peak > 0:
        raise HandbenchError(
            "echoes: the image is zero everywhere; the capture holds no echo to locate"
        )
    with np.errstate(divide="ignore"):
        return (20 * np.log10(amplitude / peak)).astype(np.float32)
