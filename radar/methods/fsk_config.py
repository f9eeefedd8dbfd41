"""Parameters of the FSK methods; the defaults are the paper's."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from handbench.radar.data.grid import MOST_ON_AXIS, Axis, GridConfig, PixelGrid
from handbench.support.config import Tone

Lateral = Annotated[Axis, Field(description="pixels")]
PAPER_LATERAL = Axis(start_m=-0.15, stop_m=0.15, step_m=0.001)
SIGMAS = 3  # a rung is out of reach when the last one's error, times this, exceeds its ambiguity


def _odd(size_px: int) -> int:
    if size_px < 1 or size_px % 2 == 0:
        raise ValueError(
            "expected an odd number ≥ 1, because an even window would shift the map by half a pixel"
        )
    if size_px > MOST_ON_AXIS:
        raise ValueError(
            f"expected a window of at most {MOST_ON_AXIS} pixels, the largest size of an axis"
        )
    return size_px


OddPixels = Annotated[int, AfterValidator(_odd)]
FirstDepth = Annotated[float, Field(gt=0, le=100)]


class PixelsConfig(GridConfig):
    """The pixels of a depth map."""

    x: Lateral = PAPER_LATERAL
    y: Lateral = PAPER_LATERAL

    def grid(self) -> PixelGrid:
        """Return the configured pixels as a grid."""
        return PixelGrid(self.x.values_m(), self.y.values_m())


class FskConfig(PixelsConfig):
    """Parameters that all FSK methods share, which find depth from the phase between images at a
    few tones."""

    first_depth_m: FirstDepth | Literal["auto"] = Field(
        default=0.45, description="z_e of the first images; auto: where the echoes are"
    )
    threshold_db: float = Field(
        default=-10.0, lt=0, description="pixels weaker than this are off target"
    )
    corrections: int = Field(
        default=1, ge=1, le=1000, description="times that z_e is corrected (paper: once)"
    )
    off_axis: bool = Field(
        default=False, description="use the path's true derivative along z instead of 2"
    )
    doppler: bool = Field(
        default=False, description="a repeated tone gives velocities and corrects depths"
    )
    tolerance: float | None = Field(
        default=1e-5, gt=0, lt=1, description="relative error of the images; null: exact"
    )
    spread_px: OddPixels = Field(
        default=9, description="window of the predicted error: two resolution cells"
    )


class AgreementConfig(GridConfig):
    """Parameters of methods that find the depth at which the phases of several tones agree: which
    depths are kept, and how they are averaged."""

    x: Lateral = PAPER_LATERAL
    y: Lateral = PAPER_LATERAL
    fine_filter_px: OddPixels = Field(
        default=5, description="filter of the result, weighted with power, pixels"
    )
    spread_px: OddPixels = Field(
        default=9, description="window of the predicted error: two resolution cells"
    )
    edge_m: float = Field(
        default=0.006, ge=0, le=1, description="pixels behind another one so close are in doubt"
    )
    drop_doubtful: bool = Field(
        default=True, description="they, and pixels without coherence, become NaN"
    )


class TwoToneConfig(FskConfig):
    """Parameters of 2-FSK, depth from two close tones; the defaults are the paper's."""

    f1_hz: Tone = Field(default=82.0e9, description="first tone")
    f2_hz: Tone = Field(
        default=81.8e9, description="second tone; |f1 − f2| sets the unambiguous range"
    )

    @property
    def ladder_hz(self) -> tuple[float, ...]:
        """The tones f1, f2 and, if there is one, f3, hertz."""
        return tuple(
            getattr(self, tone)
            for tone in ("f1_hz", "f2_hz", "f3_hz")
            if tone in type(self).model_fields
        )


class RefinedConfig(FskConfig):
    """Parameters of methods with three or more tones, whose further tones refine the depth. The
    filter sizes are ours, since the paper does not give its own."""

    coarse_filter_px: OddPixels = Field(
        default=5, description="averaging filter before each further tone, pixels"
    )
    fine_filter_px: OddPixels = Field(
        default=5, description="averaging filter of the result, pixels"
    )
    fine_refinements: int = Field(
        default=1, ge=1, le=1000, description="times that a further tone corrects each pixel"
    )
    weighted: bool = Field(default=False, description="the filters weigh each pixel with its power")
    wrap_probability: float = Field(
        default=0.1, gt=0, lt=1, description="pixels likelier than this are flagged"
    )
    drop_wrapped: bool = Field(
        default=False, description="flagged pixels are dropped (NaN) instead of kept"
    )


class ThreeToneConfig(TwoToneConfig, RefinedConfig):
    """Parameters of 3-FSK, two close tones and a third far from them; the defaults are the
    paper's."""

    f3_hz: Tone = Field(default=79.5e9, description="third tone, far from the other two")


class LadderConfig(RefinedConfig):
    """Parameters of FSK with a ladder of three or more tones: the first two, close together, find
    the depth roughly, and each further tone, further away from them, refines it."""

    phase_noise_rad: float = Field(
        default=0.03, gt=0, description="between two tones at the strongest pixel, expected"
    )
    tones_hz: tuple[Tone, ...] = Field(
        default=(82.0e9, 81.8e9, 81.3e9, 79.5e9, 72.0e9), description="the closest pair first"
    )

    @property
    def ladder_hz(self) -> tuple[float, ...]:
        """The tones, hertz, the closest pair first."""
        return self.tones_hz

    @field_validator("tones_hz")
    @classmethod
    def _climbable(cls, tones_hz: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        if len(tones_hz) < 3:
            raise ValueError("expected three or more tones; for two tones use the method 2fsk")
        if "phase_noise_rad" in info.data:  # else that is the error to report
            check_ladder(tones_hz, info.data["phase_noise_rad"])
        return tones_hz


class JointConfig(AgreementConfig, FskConfig):
    """Parameters of the method that uses three or more tones at once: the first two, the closest,
    find the target's plane, and all together find each pixel's depth."""

    off_axis: bool = Field(
        default=True, description="use the path's true derivative along z instead of 2"
    )
    tones_hz: tuple[Tone, ...] = Field(
        default=(82.0e9, 81.8e9, 80.5e9, 77.0e9, 72.0e9), description="the closest pair first"
    )
    coarse_filter_px: OddPixels = Field(
        default=5, description="averaging filter before each search, pixels"
    )
    fine_refinements: int = Field(
        default=2, ge=1, le=1000, description="times that all tones are imaged and searched"
    )
    reach_m: float = Field(
        default=0.03, gt=0, le=1, description="of the search before and behind each pixel's depth"
    )
    wrap_probability: float = Field(
        default=0.1, gt=0, lt=1, description="pixels likelier than this are flagged"
    )

    @property
    def ladder_hz(self) -> tuple[float, ...]:
        """The tones, hertz, the closest pair first."""
        return self.tones_hz

    @field_validator("tones_hz")
    @classmethod
    def _enough(cls, tones_hz: tuple[float, ...]) -> tuple[float, ...]:
        if len(set(tones_hz)) < max(3, len(tones_hz)):
            raise ValueError("expected three or more tones, all different")
        if abs(tones_hz[0] - tones_hz[1]) > np.diff(np.sort(tones_hz)).min() + 1:
            raise ValueError(
                "the first two tones are not the closest pair, which the method needs first to "
                "find the plane; put the closest pair first"
            )
        return tones_hz


def check_ladder(tones_hz: tuple[float, ...], phase_noise_rad: float) -> None:
    """Raise ValueError for a ladder of tones that cannot work: its tones are not in order of
    distance from the first two, or a step between successive tones is so large that the depth is
    ambiguous even at the strongest pixel.

    phase_noise_rad: standard deviation σ_φ of phases between two tones at the strongest pixel. The
    error σ_z = cσ_φ/(4πΔf) of one tone, times SIGMAS, must stay within the ambiguity ±c/(4Δf') of
    the next: Δf'/Δf ≤ π/(SIGMAS·σ_φ).
    """
    most = np.pi / (SIGMAS * phase_noise_rad)
    reaches_hz = [reach_hz(tones_hz[:count]) for count in range(2, len(tones_hz) + 1)]
    for rung, (last_hz, next_hz) in enumerate(pairwise(reaches_hz), start=2):
        tone = f"the tone at {tones_hz[rung] / 1e9:.4g} GHz"
        if next_hz <= last_hz or last_hz == 0:
            raise ValueError(
                f"{tone} is {next_hz / 1e9:.4g} GHz from the first tones, but the tone before it "
                f"{last_hz / 1e9:.4g} GHz; order the tones so that each is further away than the "
                "one before"
            )
        if next_hz / last_hz > most:
            between_hz = tones_hz[0] + np.sign(tones_hz[rung] - tones_hz[0]) * np.sqrt(
                last_hz * next_hz
            )
            raise ValueError(
                f"{tone} is {next_hz / last_hz:.1f} times as far away as the tone before it, but "
                f"a phase noise of {phase_noise_rad:.3g} rad allows a factor of {most:.1f} only; "
                f"add a tone near {between_hz / 1e9:.4g} GHz between them"
            )


def reach_hz(tones_hz: Iterable[float]) -> float:
    """Return the larger of the distances, in hertz, between the last tone and the first two (of two
    tones: the one distance). The depth step of the last tone is unambiguous within
    ±c/(4·distance)."""
    *others, last = tones_hz
    return max(abs(last - tone) for tone in others[:2])


AnyConfig = TwoToneConfig | ThreeToneConfig | LadderConfig | JointConfig
