"""The factors that a sensitivity study varies: a file of their own.

    settings = 64

    [factor]
    tilt_x_deg = [-10, 10]
    material = ["skin", "plastic", "metal"]

Each factor takes its values one at a time. The joint design fills the range from its lowest to its
highest value, or draws from the values where there are none between them (windows, materials). A
factor that is not listed stays as the benchmark has it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator

from handbench.radar.methods.fsk_config import OddPixels
from handbench.support.config import Config, load, suggest

DEFAULT = Path(__file__).with_name("sensitivity.toml")

Signed = tuple[float, ...]
Positive = tuple[Annotated[float, Field(ge=0)], ...]
Share = tuple[Annotated[float, Field(ge=0, le=1)], ...]
Windows = tuple[OddPixels, ...]
Kinds = tuple[Literal["skin", "plastic", "metal"], ...]


class Factors(Config):
    """The values of each factor; what is added, is added to what the scene or the benchmark has."""

    # Processing: no echo changes.
    filters_px: Windows = Field(default=(), description="both averaging filters of 3-FSK")
    coarse_filter_px: Windows = Field(
        default=(), description="averaging filter of 3-FSK before its third tone"
    )
    fine_filter_px: Windows = Field(default=(), description="averaging filter of 3-FSK's result")
    broadband_filter_px: Windows = Field(
        default=(), description="averaging filter of the broadband depth; 1: none"
    )
    narrowband_filter_px: Windows = Field(
        default=(), description="averaging filter of the narrowband depth; 1: none"
    )
    box_shift_m: Signed = Field(default=(), description="shift of the voxels along z")
    reference_error_m: Positive = Field(
        default=(), description="σ of a smooth normal error of the reference"
    )
    reference_bias_m: Signed = Field(default=(), description="shift of the reference along z")
    # The receiver: added to echoes that are there.
    phase_noise_rad: Positive = Field(
        default=(), description="noise per channel: σ of the phase between two tones"
    )
    common_phase_rad: Positive = Field(
        default=(),
        description="σ, between two tones, of a phase that all channels share, anew in each frame",
    )
    antenna_phase_rad: Positive = Field(
        default=(), description="σ of each antenna's phase, the same at all tones"
    )
    antenna_gain_db: Positive = Field(default=(), description="σ of each antenna's gain")
    f2_phase_rad: Signed = Field(
        default=(), description="phase left at the second tone, in all channels"
    )
    f3_phase_rad: Signed = Field(
        default=(), description="phase left at the third tone, in all channels"
    )
    # The scene: echoes are simulated again.
    distance_m: Signed = Field(
        default=(), description="added to the distance of the hands of the accuracy"
    )
    height_m: Signed = Field(default=(), description="added to their place along y")
    tilt_x_deg: Signed = Field(default=(), description="added to their rotation about x")
    tilt_y_deg: Signed = Field(default=(), description="added to their rotation about y")
    material: Kinds = Field(default=(), description="of the hands of the accuracy")
    roughness_m: Positive = Field(default=(), description="σ of the height of their skin")
    diffuse: Share = Field(
        default=(),
        description="share of the amplitude of their echoes that facets of random phase return",
    )
    permittivity: tuple[Annotated[float, Field(ge=1, le=20)], ...] = Field(
        default=(), description="of printed hands"
    )
    layer_m: Positive = Field(default=(), description="height of the layers of printed hands")

    def listed(self) -> dict[str, tuple[float | int | str, ...]]:
        """Factor → its values, of those that have any."""
        return {name: values for name, values in self if values}


SIMULATED = tuple(Factors.model_fields)[list(Factors.model_fields).index("distance_m") :]


def _known(names: tuple[str, ...]) -> tuple[str, ...]:
    for name in names:
        if name not in Factors.model_fields:
            raise ValueError(
                f"unknown factor '{name}'; {suggest(name, list(Factors.model_fields))}"
            )
    return names


class FactorsFile(Config):
    """The content of the file."""

    frames: int = Field(
        default=4, ge=2, le=1000, description="draws of all that is random, one factor at a time"
    )
    settings: int = Field(default=64, ge=2, le=100_000, description="of the joint design")
    placements: int = Field(
        default=8, ge=1, description="simulated ones that the joint design's settings share"
    )
    seed: int = Field(default=1, ge=0, description="of the joint design")
    within_percent: float = Field(
        default=20.0, gt=0, description="a figure so near to the paper's agrees with it"
    )
    near_percent: float = Field(
        default=12.5, gt=0, le=50, description="share of the settings that are called near"
    )
    sweep_tones: int | None = Field(
        default=None, ge=2, description="of broadband, at its resolution; none: all"
    )
    tolerance: float | None = Field(
        default=None, gt=0, lt=1, description="of the volumes; none: the method's own"
    )
    reference_correlation_m: float = Field(
        default=0.015, gt=0, description="length of the reference's error"
    )
    roughness_correlation_m: float = Field(
        default=0.002, gt=0, description="length of the skin's roughness"
    )
    apart: Annotated[tuple[str, ...], AfterValidator(_known)] = Field(
        default=(), description="factors that the joint design leaves as they are"
    )
    factor: Factors = Factors()

    @field_validator("factor")
    @classmethod
    def _each_once(cls, factor: Factors) -> Factors:
        for name, values in factor.listed().items():
            if len(set(values)) < len(values):
                raise ValueError(f"'{name}' lists a value twice; list it once")
        return factor


def load_factors(path: Path = DEFAULT) -> FactorsFile:
    """A file of factors with what it leaves out: without factors those of the default one."""
    file = load(FactorsFile, path, "a sensitivity study")
    if file.factor.listed():
        return file
    default = load_factors()
    return file.model_copy(update={"factor": default.factor, "apart": file.apart or default.apart})
