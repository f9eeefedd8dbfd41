"""Materials of surfaces."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from radar.support.config import Config

MOST_FOAM = 1.5
USUAL = {"foam": 1.03, "plastic": 2.7}  # permittivity: expanded polystyrene; printed PLA, solid


class Material(Config):
    """A body's material. metal: a perfect mirror; skin: see `radar.simulation.effects.skin`, with palm_thickness_m of
    the palm's horny layer and `wet` when moistened; foam and plastic: a dielectric with `loss_tangent` and
    `permittivity` (1.03 and 2.7 by default). reflectivity_db: of what stands around: its echo against metal's, instead
    of all this."""

    kind: Literal["metal", "skin", "foam", "plastic"] = "metal"
    permittivity: float | None = Field(default=None, ge=1, le=20)
    loss_tangent: float = Field(default=0.0, ge=0, le=1)
    palm_thickness_m: float = Field(default=140e-6, ge=0, le=2e-3)
    wet: bool = False

    @model_validator(mode="after")
    def _light_foam(self) -> Material:
        if self.kind == "foam" and self.real_permittivity > MOST_FOAM:
            raise ValueError(f"foam that rays pass straight has a permittivity of {MOST_FOAM} at most; call it plastic")
        return self

    @property
    def real_permittivity(self) -> float:
        """The dielectric's ε_r, the usual one where the scene names none."""
        return self.permittivity or USUAL.get(self.kind, 1.0)
