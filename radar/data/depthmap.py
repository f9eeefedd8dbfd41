"""Depth maps: what every method returns and what is scored."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from handbench.support.errors import HandbenchError
from handbench.support.files import read_npz, write_npz

OPTIONAL = {
    "sigma_m": "f",
    "wrapped": "b",
    "p_gross": "f",
}  # not known to every method; kinds of number
FLAGGED = 0.5  # p_gross above which a pixel counts as flagged


@dataclass(frozen=True)
class DepthMap:
    """x_m [nx], y_m [ny]; z_m [ny, nx], NaN off target; amplitude_db [ny, nx], 0 at the maximum.

    Methods that know it add, [ny, nx]: sigma_m, predicted 1σ of z_m where no phase wrapped, NaN off
    target; and wrapped (bool), pixels in doubt: their phase may have wrapped, which would put z_m
    off by a whole period, or their tones do not agree on a depth, or it is the first or last that
    was looked at. p_gross, NaN off target: the probability that z_m is off by more than 5 mm from
    the nearest true surface (`radar.methods.depth_uncertainty`).
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
        """The map without the depths whose p_gross is above `most`; HandbenchError where it has
        none."""
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
        """Write the depth map's .npz, atomically."""
        known = {name: value for name, value in vars(self).items() if value is not None}
        write_npz(path, **known | {"config": json.dumps(self.config)})


def load_depthmap(path: str | Path) -> DepthMap:
    """Read a depth map; refuses axes that do not fit the map."""
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
    """20 log10 of an amplitude relative to its maximum, in dB; an image of zeros is an error, not a
    depth map."""
    peak = amplitude.max(initial=0.0)
    if not peak > 0:
        raise HandbenchError(
            "echoes: the image is zero everywhere; the capture holds no echo to locate"
        )
    with np.errstate(divide="ignore"):
        return (20 * np.log10(amplitude / peak)).astype(np.float32)
