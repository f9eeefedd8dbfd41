"""The direct field of a short dipole, in closed form."""

from __future__ import annotations

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S

K = 2 * np.pi * 30e9 / SPEED_OF_LIGHT_M_S


def dipole_field(
    source_m: np.ndarray,
    points_m: np.ndarray,
    dipole: np.ndarray,
    component: np.ndarray | None = None,
) -> np.ndarray:
    """Component (the dipole's own if None) of (1 + ∇∇·/k²)(dipole e^{−jkR}/R): the textbook's near
    field [n]."""
    component = dipole if component is None else component
    away = points_m - source_m
    r = np.linalg.norm(away, axis=1)
    both, here = away @ dipole * (away @ component) / r**2, dipole @ component
    near = (1 + 1j * K * r) / (K * r) ** 2
    return np.exp(-1j * K * r) / r * ((here - both) - near * (here - 3 * both))
