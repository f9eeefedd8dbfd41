"""Depth maps: what every method returns and what is scored."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from radar.errors import HandbenchError
from radar.files import read_npz, write_npz


@dataclass(frozen=True)
class DepthMap:
    """x_m [nx], y_m [ny]; z_m [ny, nx], NaN off target; amplitude_db [ny, nx], 0 at the maximum."""

    x_m: np.ndarray
    y_m: np.ndarray
    z_m: np.ndarray
    amplitude_db: np.ndarray
    method: str
    config: dict[str, Any] = field(default_factory=dict)

    def save(self, path: str | Path) -> None:
        """Write the depth map's .npz, atomically."""
        write_npz(
            path,
            x_m=self.x_m,
            y_m=self.y_m,
            z_m=self.z_m,
            amplitude_db=self.amplitude_db,
            method=self.method,
            config=json.dumps(self.config),
        )


def load_depthmap(path: str | Path) -> DepthMap:
    """Read a depth map; refuses axes that do not fit the map."""
    content = read_npz(path, ("x_m", "y_m", "z_m", "amplitude_db", "method", "config"))
    shape = content["y_m"].size, content["x_m"].size
    for name, expected in {"x_m": shape[1:], "y_m": shape[:1], "z_m": shape, "amplitude_db": shape}.items():
        if content[name].shape != expected or content[name].dtype.kind != "f":
            found = f"{content[name].dtype} {content[name].shape}"
            raise HandbenchError(f"{path}: {name} is {found}; expected real numbers {expected} from y_m, x_m")
    try:
        config = json.loads(str(content["config"]))
    except ValueError as error:
        raise HandbenchError(f"{path}: config is not JSON ({error}); expected the method's configuration") from None
    return DepthMap(
        content["x_m"],
        content["y_m"],
        content["z_m"],
        content["amplitude_db"],
        str(content["method"]),
        config,
    )


def amplitude_db(amplitude: np.ndarray) -> np.ndarray:
    """20 log10 of an amplitude relative to its maximum, in dB; an image of zeros is an error, not a depth map."""
    peak = amplitude.max(initial=0.0)
    if not peak > 0:
        raise HandbenchError("echoes: the image is zero everywhere; the capture holds no echo to locate")
    with np.errstate(divide="ignore"):
        return (20 * np.log10(amplitude / peak)).astype(np.float32)
