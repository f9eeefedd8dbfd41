"""Signed errors of a depth map, as a result folder keeps them."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ErrorMap:
    """Signed errors of one depth map on the pixel centres x_m [nx], y_m [ny]; all others [ny, nx], metres.

    error_m = z − z_ref, NaN where unobserved; reference_z_m, NaN where there is no surface. Where it is known (else
    None): sigma_m, the reference's standard deviation along z; to_reference_m, the distance of the map's point to the
    reference, NaN where the map is not judged; to_map_m, that of the reference's point to the map.
    """

    x_m: np.ndarray
    y_m: np.ndarray
    error_m: np.ndarray
    reference_z_m: np.ndarray
    sigma_m: np.ndarray | None = None
    to_reference_m: np.ndarray | None = None
    to_map_m: np.ndarray | None = None
