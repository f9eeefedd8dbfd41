"""Errors of a registration whose truth is known, and whether its covariance told them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.bench.tradeoff.simulated_sections import VOLUME_M, errors_m
from handbench.calibration.registration.register import HAND_M
from handbench.calibration.transforms import Transform, adjoint


@dataclass(frozen=True)
class Score:
    """shift_m [3]: how far the hand's centre is off; turn_rad [3]: the rotation's error; tre_m [n]:
    distance from the truth at VOLUME_M, and predicted_m [n]: its root mean square by the
    covariance; nees: eᵀC⁻¹e, χ² of 6."""

    shift_m: np.ndarray
    turn_rad: np.ndarray
    tre_m: np.ndarray
    predicted_m: np.ndarray
    nees: float


def score(found: Transform, true: Transform) -> Score:
    """Compare radar_from_photo with the truth."""
    back = true.inverse()
    shift_m = found.points(back.points(HAND_M)) - HAND_M
    turn_rad = Rotation.from_matrix(found.rotation @ true.rotation.T).as_rotvec()
    tre_m = errors_m(found, true)
    predicted_m = np.sqrt(np.trace(found.point_covariance(VOLUME_M), axis1=1, axis2=2))
    error = np.concatenate([shift_m, turn_rad])
    carry = adjoint(HAND_M, 6)
    return Score(
        shift_m,
        turn_rad,
        tre_m,
        predicted_m,
        float(error @ np.linalg.solve(carry @ found.covariance @ carry.T, error)),
    )
