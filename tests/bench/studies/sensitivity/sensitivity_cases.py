"""The settings: the benchmark as it is, each factor by itself, and a joint design over all of
them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import qmc

from tests.bench.studies.sensitivity.sensitivity_factors import SIMULATED, FactorsFile

Value = float | int | str
BASE, WHOLE = "as the benchmark has it", "without the study's economies"
UNITS = (
    ("_deg", 1, "°"),
    ("_rad", 1, " rad"),
    ("_px", 1, " px"),
    ("_db", 1, " dB"),
    ("_m", 1e3, " mm"),
)


@dataclass(frozen=True)
class Case:
    """One setting. values: of the factors that differ from the benchmark's; draws: of all that is
    random, by number, each with figures of its own; economies: whether tones and tolerance are the
    study's; placement: in the joint design the number of the simulated placement that it shares."""

    number: int
    name: str
    values: Mapping[str, Value] = field(default_factory=dict)
    draws: tuple[int, ...] = (0,)
    economies: bool = True
    placement: int = -1


def one_at_a_time(file: FactorsFile) -> list[Case]:
    """The benchmark itself, with and without the economies, and every value of every factor."""
    draws = tuple(range(file.frames))
    cases = [Case(0, BASE, draws=draws), Case(1, WHOLE, draws=draws, economies=False)]
    for factor, values in file.factor.listed().items():
        cases += [
            Case(len(cases) + n, told(factor, v), {factor: v}, draws) for n, v in enumerate(values)
        ]
    return cases


def joint(file: FactorsFile) -> list[Case]:
    """The settings of the joint design, sorted by placement: Latin hypercubes, one over the factors
    that only change what is received or processed, and one of fewer points over those that are
    simulated."""
    listed = {
        name: values for name, values in file.factor.listed().items() if name not in file.apart
    }
    cheap = {name: values for name, values in listed.items() if name not in SIMULATED}
    rows = filled(cheap, file.settings, file.seed)
    places = filled(
        {n: v for n, v in listed.items() if n in SIMULATED}, file.placements, file.seed + 1
    )
    cases = [
        Case(
            number,
            f"setting {number}",
            {**row, **places[number % len(places)]},
            (number,),
            True,
            number % len(places),
        )
        for number, row in enumerate(rows)
    ]
    return sorted(cases, key=lambda case: case.placement)


def filled(factors: Mapping[str, Sequence[Value]], count: int, seed: int) -> list[dict[str, Value]]:
    """`count` points of a Latin hypercube: of each factor one in each of `count` equal parts of its
    range, or each of its values equally often."""
    if not factors:
        return [{} for _ in range(count)]
    unit = qmc.LatinHypercube(len(factors), rng=np.random.default_rng(seed)).random(count)
    return [
        {name: _at(factors[name], u) for name, u in zip(factors, row, strict=True)} for row in unit
    ]


def _at(values: Sequence[Value], share: float) -> Value:
    """The value at a share of the range, or the choice there."""
    if ranged(values):
        numbers = np.array(values, float)
        return float(numbers.min() + share * np.ptp(numbers))
    return values[int(share * len(values))]


def ranged(values: Sequence[Value]) -> bool:
    """True where there are values between these."""
    return all(isinstance(value, float) for value in values)


def told(factor: str, value: Value) -> str:
    """A factor and its value in words, as "distance 15 mm"."""
    return f"{titled(factor)} {shown(factor, value)}"


def titled(factor: str) -> str:
    """A factor's name without its unit."""
    return factor.removesuffix(unit_of(factor)[0]).replace("_", " ")


def shown(factor: str, value: Value) -> str:
    """A factor's value with the unit that a person reads."""
    _, scale, unit = unit_of(factor)
    return value if isinstance(value, str) else f"{scale * value:.3g}{unit}"


def unit_of(factor: str) -> tuple[str, float, str]:
    return next((unit for unit in UNITS if factor.endswith(unit[0])), ("", 1, ""))
