"""The sweep: sections one after the other, and the folder that they fill."""

from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import tomlkit

from handbench.bench.results import (
    Section,
    Setting,
    Tradeoff,
    TradeoffFacts,
    load_tradeoff,
    write_config,
    write_tradeoff,
)
from handbench.bench.run.benchmark_file import BenchFile
from handbench.bench.run.planned_cost import of_sweep
from handbench.bench.run.sweep import Sweep, completed, imaging_settings, known_configs
from handbench.bench.studies.tradeoff import imaging_stage
from handbench.bench.studies.tradeoff.answer import front, rank, with_acquisition
from handbench.bench.studies.tradeoff.measuring import carried_out, stand
from handbench.bench.studies.tradeoff.opening import Context, Opened, opened
from handbench.bench.studies.tradeoff.settings import FOLDER, write_settings
from handbench.support.config import parse
from handbench.support.cost import require_time
from handbench.support.errors import HandbenchError
from handbench.support.folder import claimed, drop
from handbench.support.progress import say
from handbench.support.store import versions

KNOBS = {"groundtruth": "GroundTruthKnobs", "simulation": "SimulationKnobs", "registration": "RegistrationKnobs"}
PAPER_METHODS = ("2fsk", "3fsk", "broadband", "narrowband")
STEP = "an assumption: the sensor's time for one tone of all antennas is not published; `step_s` of [tradeoff] sets it"
FILES = ("tradeoff.json", "tradeoff.csv", "config.toml", FOLDER)


@dataclass
class _Found:
    """The outcome of the sections."""

    sections: list[Section] = field(default_factory=list)
    settings: list[Setting] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    imaging: imaging_stage.Imaging | None = None


def run(
    bench: BenchFile, base: Path, folder: Path, sections: tuple[str, ...] | None = None, overwrite: bool = False
) -> Tradeoff:
    """Sweep a benchmark whose paths start from `base` into a trade-off folder. A folder that holds the same trade-off
    of the same inputs and versions is read, not measured again, unless `overwrite` asks for it."""
    sweep = completed(bench.tradeoff)
    if sections is not None:
        sweep = parse(Sweep, {**sweep.model_dump(), "sections": sections}, "--sections")
    bench = bench.model_copy(update={"tradeoff": sweep})
    settings = imaging_settings(sweep, known_configs(bench.method))  # what is wrong is said before anything is measured
    if "imaging" in sweep.sections:
        work_ahead = of_sweep(bench, base, settings, sweep.repeats)
        what = f"imaging: {len(bench.capture)} captures × {len(settings)} settings"
        require_time(work_ahead.core_s, what, work_ahead.bytes_)
    knobs = {name: _knobs(name, sweep) for name in sweep.sections if name in KNOBS}
    config = tomlkit.dumps(bench.model_dump(mode="json", exclude_none=True))
    with claimed(folder) as work:
        same = _check_room(folder, config, overwrite)
        ready = opened(bench, base, work, photographed=int("groundtruth" in sweep.sections))
        if same and not overwrite and (kept := _kept(folder, ready)) is not None:
            say(f"{folder}: holds this trade-off already; its figures are taken from there, --overwrite measures anew")
            return kept
        context = Context(bench, base.resolve(), work.resolve(), ready.captures, bench.seed, sweep.repeats)
        found = _measured(sweep, knobs, context, ready)
        _write(folder, found, config, context, ready)
    return load_tradeoff(folder)


def _knobs(name: str, sweep: Sweep) -> Any:
    """The section's knobs, checked before anything is measured."""
    model = getattr(import_module(f"handbench.bench.studies.tradeoff.{name}_stage"), KNOBS[name])
    return parse(model, getattr(sweep, name), f"tradeoff.{name}")


def _check_room(folder: Path, config: str, overwrite: bool) -> bool:
    """True where the folder's configuration is this one; another's trade-off and a run's results are not mixed with."""
    if (folder / "result.json").exists():
        raise HandbenchError(f"{folder}: holds the results of `handbench run`; choose another -o")
    before = folder / "config.toml"
    same = before.exists() and before.read_text("utf-8", "replace") == config
    if before.exists() and not same and not overwrite:
        raise HandbenchError(
            f"{folder}: holds the trade-off of another configuration; choose another -o, or --overwrite to replace it"
        )
    return same


def _kept(folder: Path, ready: Opened) -> Tradeoff | None:
    if not (folder / "tradeoff.json").exists():
        return None
    kept = load_tradeoff(folder)
    same = kept.facts.inputs == ready.found.inputs and kept.facts.versions == versions()
    return kept if same else None


def _measured(sweep: Sweep, knobs: dict[str, Any], context: Context, ready: Opened) -> _Found:
    """The sections in order; one that fails is said and recorded, unless all do."""
    found = _Found()

    def measure(name: str) -> None:
        if name == "imaging":
            found.imaging = imaging_stage.measure(sweep, context, ready)
            given = found.imaging.section, found.imaging.lines
        else:
            given = import_module(f"handbench.bench.studies.tradeoff.{name}_stage").measure(knobs[name], context)
        if given is None:
            raise HandbenchError("nothing to measure: the benchmark has not what this section needs")
        found.sections.append(given[0])
        found.settings += rank(given[1], given[0].reference)

    _, failed = carried_out(sweep.sections, measure, str, "section")
    if not found.sections:
        raise HandbenchError(f"every section failed; the first: {next(iter(failed.values()))}")
    found.facts = {**(found.imaging.facts if found.imaging else {}), "step_s": sweep.step_s, "step_s_source": STEP}
    if failed:
        found.facts["failed_sections"] = failed
    if found.imaging is not None:
        found.facts["fronts"] = _fronts([s for s in found.settings if s.section == "imaging"])
    return found


def _fronts(settings: list[Setting]) -> dict[str, list[str]]:
    """The imaging front, that among the paper's own methods, and that with the acquisition's time: names."""
    papers = [s for s in settings if s.method in PAPER_METHODS]
    acquired = [with_acquisition(s) for s in settings if s.acquisition_s is not None]
    named = {"all": settings, "paper_methods": papers, "with_acquisition": acquired}
    return {name: [s.name for s in front(some)] for name, some in named.items()}


def _write(folder: Path, found: _Found, config: str, context: Context, ready: Opened) -> None:
    """Earlier figures give way only when the new ones stand; tradeoff.json comes last."""
    drop(folder, FILES)
    write_config(folder, config)
    if found.imaging is not None:
        places = context.base, context.work, context.captures, ready.targets
        write_settings(folder, context.bench, *places, found.imaging.settings.values())
    facts = TradeoffFacts(
        name=context.bench.name,
        scored_against=ready.reference,
        sections=tuple(found.sections),
        claims=found.imaging.claims if found.imaging else (),
        captures=tuple(capture.name for capture in context.captures),
        inputs=ready.found.inputs,
        facts=found.facts,
        **stand(),
    )
    write_tradeoff(folder, facts, found.settings)
