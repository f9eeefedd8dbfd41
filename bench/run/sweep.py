"""The parameters that a trade-off varies: the [tradeoff] table of a benchmark file.

An imaging entry has a method, fixed settings (`config`) and settings with several values (`sweep`):

    [[tradeoff.imaging]]
    method = "broadband"
    config = { tolerance = 1e-3 }
    sweep = { "z.step_m" = [1e-3, 2e-3] }
    every_nth_antenna = [1, 2]

Each key of `sweep` is a parameter; a dot leads into a table. Its list holds the values to try. With
several keys, all combinations are tried. A value may itself be a list (tones_hz = [[…], […]]).
Parameters that change together share a key, separated by commas: "x.step_m,y.step_m".
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from handbench.bench.evaluation.metrics import TITLES
from handbench.groundtruth.options import Quality
from handbench.groundtruth.photos.photos import FEWEST
from handbench.radar.methods.registry import method
from handbench.support.config import Config, checked_name, load
from handbench.support.errors import HandbenchError
from handbench.support.limits import MOST_TABLES

SectionName = Literal["imaging", "groundtruth"]
SECTIONS: tuple[SectionName, ...] = ("imaging", "groundtruth")
UNITS = (("_hz", 1e-9, "GHz"), ("_m", 1e3, "mm"))  # what names say in place of suffixes
MOST_VALUES = 100  # of one parameter
DEFAULT = Path(__file__).parent / "benchmarks" / "tradeoff.toml"


@dataclass(frozen=True)
class ImagingSetting:
    """One setting of a trade-off's imaging: a method, its configuration, and the share of the
    antennas.
    varied: the parameters that form its name and distinguish it from other settings, as in
    broadband-tolerance-1e-3."""

    name: str
    title: str
    method: str
    config: dict[str, Any]
    every_nth_antenna: int
    varied: dict[str, Any]


class ImagingEntry(Config):
    """The settings of one method that a trade-off tries: all combinations of the listed values.
    config: parameters with the same value in all settings. sweep: parameter → values to try; a key
    may name several parameters, separated by commas, that change together. every_nth_antenna:
    values n to try; n keeps every n-th transmitter and every n-th receiver."""

    method: str
    title: str = ""
    config: dict[str, Any] = Field(default_factory=dict)
    sweep: dict[str, tuple[Any, ...]] = Field(default_factory=dict)
    every_nth_antenna: tuple[int, ...] = (1,)

    @field_validator("sweep")
    @classmethod
    def _alternatives(cls, sweep: dict[str, tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
        for key, values in sweep.items():
            if not values:
                raise ValueError(f"'{key}' has no values; list at least one value")
        count = prod(map(len, sweep.values()))
        if count > MOST_TABLES:
            raise ValueError(
                f"its lists make {count} settings, more than {MOST_TABLES}; list fewer values"
            )
        return sweep

    @field_validator("every_nth_antenna")
    @classmethod
    def _from_one(cls, every: tuple[int, ...]) -> tuple[int, ...]:
        if not every or min(every) < 1 or max(*every, len(every)) > MOST_TABLES:
            raise ValueError(
                f"expected a list of at most {MOST_TABLES} whole numbers, each from 1 (all "
                f"antennas) to {MOST_TABLES}"
            )
        return every


class GroundTruthKnobs(Config):
    """The parameters of photogrammetry that a trade-off varies, each with the values to try.
    views: number of photographs, evenly chosen; long_px: length of their longer side after
    shrinking, pixels (they are never enlarged); quality: that of the depth maps, with the values of
    `handbench groundtruth --quality`."""

    views: tuple[Annotated[int, Field(ge=FEWEST)], ...] = Field(
        default=(5, 8), min_length=1, max_length=MOST_VALUES
    )
    long_px: tuple[Annotated[int, Field(ge=64)], ...] = Field(
        default=(1200, 2400), min_length=1, max_length=MOST_VALUES
    )
    quality: tuple[Quality, ...] = Field(
        default=("draft", "normal"), min_length=1, max_length=MOST_VALUES
    )


class TradeoffSweep(Config):
    """The table [tradeoff] of a benchmark file: which stages are varied, and over which parameters.
    repeats: how often each setting is timed, in rounds over all settings. step_s: the sensor's time
    to measure one tone with all antennas, from which acquisition times follow. reference: the
    imaging setting whose time is 1 in ratios of times (None: the first). exact_planes: number of
    planes of a volume that are summed exactly; their time is scaled to the whole volume."""

    repeats: int = Field(default=3, ge=1, le=100)
    step_s: float = Field(default=1e-3, ge=0)
    reference: str | None = None
    exact_planes: int = Field(default=1, ge=1)
    sections: tuple[SectionName, ...] = Field(default=SECTIONS, min_length=1)
    imaging: tuple[ImagingEntry, ...] = ()
    groundtruth: GroundTruthKnobs = Field(default_factory=GroundTruthKnobs)


def complete_sweep(sweep: TradeoffSweep | None) -> TradeoffSweep:
    """Return the [tradeoff] table with its missing parts filled in from the default one.
    Without imaging entries it gets those of the default table, and their reference setting. None:
    the whole default table."""
    if sweep is None:
        return default()
    if sweep.imaging:
        return sweep
    return sweep.model_copy(
        update={"imaging": default().imaging, "reference": sweep.reference or default().reference}
    )


@cache
def default() -> TradeoffSweep:
    """Return the [tradeoff] table that is used for benchmarks without one."""
    return load(TradeoffSweep, DEFAULT, "a sweep")


def imaging_settings(
    sweep: TradeoffSweep, known: dict[str, dict[str, Any]]
) -> list[ImagingSetting]:
    """List all imaging settings of a trade-off, each with its checked configuration and a unique
    name.
    known: method → settings of the benchmark's own entry; they apply unless the trade-off overrides
    them. Raises HandbenchError for a parameter that the method does not have, or for a setting that
    is listed twice."""
    settings: list[ImagingSetting] = []
    for setting in (
        s for entry in sweep.imaging for s in _of_entry(entry, known.get(entry.method, {}))
    ):
        namesakes = [
            s
            for s in settings
            if s.name == setting.name or s.name.startswith(f"{setting.name}-no-")
        ]
        changes = setting.method, setting.config, setting.every_nth_antenna
        if any(changes == (s.method, s.config, s.every_nth_antenna) for s in namesakes):
            raise HandbenchError(
                f"tradeoff.imaging: '{setting.name}' is listed twice; list it once"
            )
        # tables show nothing but the name
        number = f"-no-{len(namesakes) + 1}" if namesakes else ""
        settings.append(replace(setting, name=_checked(setting.name + number)))
    names = [setting.name for setting in settings]
    if sweep.reference is not None and sweep.reference not in names:
        raise HandbenchError(
            f"tradeoff.reference: there is no setting '{sweep.reference}'; known: "
            f"{', '.join(names)}"
        )
    return settings


def known_configs(entries: Iterable[Any]) -> dict[str, dict[str, Any]]:
    """Collect the settings that the benchmark gives each method: method id → settings.
    entries: the benchmark's methods, each with `id` and `config`."""
    return {entry.id: entry.config for entry in entries}


def _of_entry(entry: ImagingEntry, known: dict[str, Any]) -> list[ImagingSetting]:
    chosen, settings = method(entry.method), []
    where = f"tradeoff.imaging '{entry.method}'"
    fixed = {key: value for key, value in entry.config.items() if not isinstance(value, dict)}
    for values in product(*entry.sweep.values(), entry.every_nth_antenna):
        swept, every = dict(zip(entry.sweep, values[:-1], strict=True)), values[-1]
        config = {**known, **entry.config}
        for keys, value in swept.items():
            for key in keys.split(","):
                config = _with(
                    config,
                    key.strip(),
                    value,
                    chosen.configure(config, where).model_dump(mode="json"),
                )
        chosen.configure(config, where)
        varied = {**fixed, **swept, **({"every_nth_antenna": every} if every > 1 else {})}
        name = "-".join([entry.method, *("-".join(_abbreviated(*knob)) for knob in varied.items())])
        title = ", ".join(
            [entry.title or TITLES.get(entry.method, entry.method), *map(_words, varied.items())]
        )
        settings.append(ImagingSetting(name, title, entry.method, config, every, varied))
    return settings


def _checked(name: str) -> str:
    try:
        return checked_name(name)
    except ValueError as error:
        raise HandbenchError(f"tradeoff.imaging: {error}; set fewer parameters") from None


def _with(config: dict[str, Any], key: str, value: Any, resolved: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of a method's configuration with one parameter changed.
    key: the parameter; a dot leads into a table, as in z.step_m. resolved: the configuration with
    all values, from which the rest of that table is copied. Raises HandbenchError if the key leads
    into something that is not a table."""
    first, *inner = key.split(".")
    if not inner:
        return {**config, key: value}
    table = resolved.get(first)
    if not isinstance(table, dict):
        raise HandbenchError(
            f"tradeoff.imaging: '{key}' is inside '{first}', which is not a table of the method; "
            "correct the key"
        )
    return {**config, first: _with(table, ".".join(inner), value, table)}


def _words(knob: tuple[str, Any]) -> str:
    key, value = knob
    if key == "every_nth_antenna":
        return f"1 of {value} antennas"
    return " ".join(_abbreviated(key, value)).replace("_", " ")


def _abbreviated(keys: str, value: Any) -> tuple[str, str]:
    """Shorten a parameter and its value for use in names: "z.step_m", 2e-3 → ("z.step", "2mm").
    Several parameters that change together become one word, such as xyz.step."""
    names = [key.strip() for key in keys.split(",")]
    leaf = names[0].rpartition(".")[2]
    together = len(names) > 1 and all(name.endswith(f".{leaf}") for name in names)
    knob = (
        "".join(name.removesuffix(f".{leaf}") for name in names) + f".{leaf}"
        if together
        else "+".join(names)
    )
    suffix, scale, unit = next((u for u in UNITS if knob.endswith(u[0])), ("", 1, ""))
    return knob.removesuffix(suffix), _short(value, scale) + unit


def _short(value: Any, scale: float = 1) -> str:
    if isinstance(value, dict):
        return "_".join(_short(v) for v in value.values())
    if isinstance(value, list | tuple):
        return "_".join(_short(v, scale) for v in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if scale == 1 and isinstance(value, int):
        return str(value)
    mantissa, _, exponent = f"{value * scale:.12e}".partition("e")
    short = f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    return min(short, f"{value * scale:.12g}", key=len)
