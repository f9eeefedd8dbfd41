"""Dielectric properties of skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

VACUUM_F_M = 8.8541878128e-12


@dataclass(frozen=True)
class ColeCole:
    """ε_r(ω) = ε_∞ + Σ_n Δε_n / (1 + (jωτ_n)^(1−α_n)) + σ/(jωε_0), time e^{+jωt}."""

    infinity: float
    step: tuple[float, ...]  # Δε
    relaxation_s: tuple[float, ...]  # τ
    broadening: tuple[float, ...]  # α
    conductivity_s_m: float = 0.0  # σ of ions

    def permittivity(self, frequencies_hz: np.ndarray) -> np.ndarray:
        """Complex relative permittivity [f]."""
        omega = 2 * np.pi * np.asarray(frequencies_hz, float)[:, None]
        step, relaxation_s, broadening = map(np.array, (self.step, self.relaxation_s, self.broadening))
        dispersions = step / (1 + (1j * omega * relaxation_s) ** (1 - broadening))
        return self.infinity + dispersions.sum(axis=1) + self.conductivity_s_m / (1j * omega[:, 0] * VACUUM_F_M)


# Skin as a whole: S. Gabriel, R. W. Lau, C. Gabriel, Phys. Med. Biol. 41 (1996) 2271, table 1; measured up to 20 GHz,
# extrapolated here. Skin at 40–110 GHz: Christ et al., Bioelectromagnetics 42 (2021), doi 10.1002/bem.22362.
DRY = ColeCole(
    4.0, (32.0, 1100.0, 0.0, 0.0), (7.234e-12, 32.481e-9, 159.155e-6, 15.915e-3), (0.0, 0.2, 0.2, 0.2), 0.0002
)
WET = ColeCole(4.0, (39.0, 280.0, 3e4, 3e4), (7.958e-12, 79.577e-9, 1.592e-6, 1.592e-3), (0.1, 0.0, 0.16, 0.2), 0.0004)
# Horny layer (stratum corneum): the Debye term of free water of Alekseev & Ziskin, Bioelectromagnetics 28 (2007) 331.
HORNY = ColeCole(2.96, (1.5,), (6.9e-12,), (0.0,))

# What represents arm and face in the measurements of Christ et al., and 140 µm the palm; manual work thickens that.
THIN_M = 15e-6


def skin_permittivity(frequencies_hz: np.ndarray, wet: bool = False) -> np.ndarray:
    """Complex relative permittivity [f] of skin as a whole, e^{+jωt}."""
    return (WET if wet else DRY).permittivity(frequencies_hz)
