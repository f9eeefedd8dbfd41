"""The measurement of a trade-off: its sections one after the other, and the folder with the
results."""

import os
import shutil
import traceback
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomlkit

from handbench.bench.datasets.dataset import AT_EMPTY_FILTERED, open_capture
from handbench.bench.results import (
    Failure,
    Tradeoff,
    TradeoffFacts,
    load_tradeoff,
    write_config,
    write_tradeoff,
)
from handbench.bench.run.benchmark_file import BenchFile, MethodEntry, Source
from handbench.bench.run.executors import LocalExecutor
from handbench.bench.run.outcome import RunCapture
from handbench.bench.run.planned_cost import of_sweep, one_after_another
from handbench.bench.run.runner import Run
from handbench.bench.run.sweep import TradeoffSweep, complete_sweep, imaging_settings, known_configs
from handbench.bench.tradeoff.groundtruth import measure_groundtruth
from handbench.bench.tradeoff.imaging import measure_imaging
from handbench.bench.tradeoff.settings import (
    MeasuredSection,
    TradeoffInputs,
    front,
    rank,
    with_acquisition,
)
from handbench.radar.imaging.device import describe
from handbench.support.config import parse
from handbench.support.cost import calibrated_machine, require_time
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text
from handbench.support.folder import drop, locked
from handbench.support.progress import part, predicted_work, say
from handbench.support.store import versions

MEASURE = {"imaging": measure_imaging, "groundtruth": measure_groundtruth}
PAPER_METHODS = ("2fsk", "3fsk", "broadband", "narrowband")
STEP = (
    "an assumption: the sensor's time for one tone of all antennas is not published; `step_s` "
    "of [tradeoff] sets it"
)
SETTINGS, CAPTURES = "settings", "captures"
FILES = ("tradeoff.json", "tradeoff.csv", "config.toml", SETTINGS)


def run(
    bench: BenchFile,
    base: Path,
    folder: Path,
    sections: tuple[str, ...] | None = None,
    overwrite: bool = False,
) -> Tradeoff:
    """Measure a trade-off, error against time of many settings, write it to a folder, and return
    it.

    bench: the benchmark with its sweep of settings, whose paths are relative to `base`. sections:
    the sections to measure (None: those of the sweep). If the folder has the same trade-off, from
    the same inputs and versions, it is only read. overwrite: measure anew, and replace another
    trade-off.

    Raises HandbenchError if the folder has other contents, the predicted time is too long, or all
    sections fail.
    """
    sweep = complete_sweep(bench.tradeoff)
    if sections is not None:
        sweep = parse(TradeoffSweep, {**sweep.model_dump(), "sections": sections}, "--sections")
    bench = bench.model_copy(update={"tradeoff": sweep})
    # errors are reported before anything is measured
    settings = imaging_settings(sweep, known_configs(bench.method))
    predicted = of_sweep(bench, base, sweep, settings)
    ahead = one_after_another(predicted.values())
    what = f"{', '.join(sweep.sections)}: {len(bench.capture)} captures"
    if "imaging" in sweep.sections:
        what += f" × {len(settings)} settings"
    require_time(ahead.core_s, what, ahead.bytes_)
    config = tomlkit.dumps(bench.model_dump(mode="json", exclude_none=True))
    with locked(folder) as work, predicted_work(ahead.core_s):
        same = _check_room(folder, config, overwrite)
        with part("captures", predicted["captures"].core_s):
            inputs = open_inputs(bench, base, work)
        inputs = replace(
            inputs, predicted_s={name: each.core_s for name, each in predicted.items()}
        )
        if same and not overwrite and (folder / "tradeoff.json").exists():
            before = load_tradeoff(folder)
            if before.facts.inputs == inputs.found.inputs and before.facts.versions == versions():
                say(
                    f"{folder}: has this trade-off already, so its figures are used again; "
                    "--overwrite measures them again"
                )
                return before
        measured, facts = _measure_sections(inputs)
        _write(folder, config, inputs, measured, facts)
    return load_tradeoff(folder)


def _check_room(folder: Path, config: str, overwrite: bool) -> bool:
    """Return True if the folder already has a trade-off with this configuration. Raises
    HandbenchError if it has one with another configuration (unless `overwrite`), or the results of
    a run."""
    if (folder / "result.json").exists():
        raise HandbenchError(f"{folder}: has the results of `handbench run`; choose another folder")
    before = folder / "config.toml"
    same = before.exists() and before.read_text("utf-8", "replace") == config
    if before.exists() and not same and not overwrite:
        raise HandbenchError(
            f"{folder}: has the trade-off of another configuration; choose another folder, or "
            "replace it (--overwrite)"
        )
    return same


def open_inputs(bench: BenchFile, base: Path, work: Path) -> TradeoffInputs:
    """Open or simulate the captures of a trade-off, and find the surfaces that they are scored
    against. work: folder of the run's stages.

    Meshes are reconstructed from photographs only if a capture has no true surface. Scenes have
    one: if all captures are scenes, only the first is photographed, and only for the section on
    ground truth. Raises HandbenchError if no capture can be scored.
    """
    assert bench.tradeoff is not None
    sources = tuple(source for source in bench.capture if "accuracy" in source.measures)
    if all(source.scene is not None for source in sources):
        count = int("groundtruth" in bench.tradeoff.sections)
        sources = (
            *sources[:count],
            *(s.model_copy(update={"photos": False}) for s in sources[count:]),
        )
    whole = bench.model_copy(update={"capture": sources, "method": (), "tradeoff": None})
    uncalibrated, base, work = (
        whole.model_copy(update={"calibration": ()}),
        base.resolve(),
        work.resolve(),
    )
    job, reference = Run(uncalibrated, base, work, LocalExecutor()), "truth"
    job.open()
    if any(open_capture(capture.folder).truth is None for capture in job.found.captures):
        job, reference = Run(whole, base, work, LocalExecutor()), "photogrammetry"
        job.open()
    job.inspect()
    if reference != "truth":
        stages = job.photographed()
        job.collect(stages, job.perform(stages))
    job.find_references()
    found = job.found
    message = f"has no {reference}, which the other settings are compared with"
    without = [name for name, files in found.references.items() if reference not in files]
    found.failures += [
        Failure(capture=name, stage="references", message=message) for name in without
    ]
    inputs = TradeoffInputs(bench, base, work, found, reference, job.targets)
    if not inputs.captures:
        raise HandbenchError(
            f"every capture failed; the error of the first: {found.failures[0].message}"
        )
    return inputs


def _measure_sections(inputs: TradeoffInputs) -> tuple[list[MeasuredSection], dict[str, Any]]:
    """Measure the sections one after the other: (sections, with the settings on the front marked,
    facts for the result). A section that fails is reported and recorded. Raises HandbenchError if
    all fail."""
    found: list[MeasuredSection] = []
    failed: dict[str, str] = {}
    for name in inputs.sweep.sections:
        try:
            found.append(MEASURE[name](inputs))
        except HandbenchError as error:
            failed[name] = str(error)
            say(f"section: {name} failed: {error}")
        except Exception as error:  # what the other sections took minutes for is not lost
            failed[name] = f"{type(error).__name__}: {error}"
            say(traceback.format_exc())
    if not found:
        raise HandbenchError(
            f"every section failed; the error of the first: {next(iter(failed.values()))}"
        )
    facts = {key: value for one in found for key, value in one.facts.items()}
    facts |= {"step_s": inputs.sweep.step_s, "step_s_source": STEP}
    facts |= {"failed_sections": failed} if failed else {}
    for one in found:
        one.lines[:] = rank(one.lines, one.section.reference)
        if one.section.name == "imaging":
            papers = [s for s in one.lines if s.method in PAPER_METHODS]
            named = {
                "all": one.lines,
                "paper_methods": papers,
                "with_acquisition": with_acquisition(one.lines),
            }
            facts["fronts"] = {name: [s.name for s in front(some)] for name, some in named.items()}
    return found, facts


def _write(
    folder: Path,
    config: str,
    inputs: TradeoffInputs,
    measured: list[MeasuredSection],
    facts: dict[str, Any],
) -> None:
    """Write the folder of a trade-off. Earlier results are removed first, once the new ones are
    complete; tradeoff.json is written last. config: text of config.toml."""
    drop(folder, FILES)
    write_config(folder, config)
    for one in measured:
        if one.runnable:
            _write_settings(folder, inputs, one)
    about = TradeoffFacts(
        name=inputs.bench.name,
        scored_against=inputs.reference,
        sections=tuple(one.section for one in measured),
        claims=tuple(claim for one in measured for claim in one.claims),
        captures=tuple(capture.name for capture in inputs.captures),
        inputs=inputs.found.inputs,
        facts=facts,
        machine={**calibrated_machine(), "imaging_device": describe()},
        versions=versions(),
    )
    write_tradeoff(folder, about, [line for one in measured for line in one.lines])


def setting_path(folder: Path, name: str) -> Path:
    """Return the path of a setting's benchmark file in the folder of a trade-off."""
    return folder / SETTINGS / f"{name}.toml"


def _write_settings(folder: Path, inputs: TradeoffInputs, imaging: MeasuredSection) -> None:
    """Write each imaging setting as a benchmark file that can be run, settings/NAME.toml.

    A benchmark may read only files below its own folder. The scored captures and those of the
    calibration target are therefore put there too, as hard links, or as copies if the file system
    has none.
    """
    captures, targets = (
        _link_captures(some, folder / SETTINGS, inputs)
        for some in (inputs.captures, inputs.targets)
    )
    for setting in imaging.runnable:
        entry = MethodEntry(
            id=setting.method, config=setting.config, every_nth_antenna=setting.every_nth_antenna
        )
        given = {
            "name": setting.name,
            "capture": captures,
            "calibration": targets,
            "method": (entry,),
        }
        others = {"phase_noise_rad": None, "dataset": None, "tradeoff": None}
        benchmark = inputs.bench.model_copy(update={**given, **others}).model_dump(
            mode="json", exclude_none=True
        )
        comment = (
            f"# {setting.title}: a setting of a trade-off, with its captures. Run it with "
            "`handbench run`.\n"
        )
        write_text(setting_path(folder, setting.name), comment + tomlkit.dumps(benchmark))


def _link_captures(
    captures: Iterable[RunCapture], into: Path, inputs: TradeoffInputs
) -> tuple[Source, ...]:
    """Put captures into the folder `into`, as hard links or copies, and return them as entries of a
    benchmark file.

    A recorded capture keeps its relative path, from which some data sets take names; a simulated
    one gets its name as path.
    """
    sources = []
    for capture in captures:
        folder = capture.folder.resolve()
        recorded = folder.is_relative_to(inputs.base) and not folder.is_relative_to(inputs.work)
        place = folder.relative_to(inputs.base) if recorded else Path(CAPTURES) / capture.name
        real, target = (
            path.with_name(path.name.removesuffix(AT_EMPTY_FILTERED))
            for path in (folder, into / place)
        )
        shutil.copytree(real, target, copy_function=_link_or_copy, dirs_exist_ok=True)
        sources.append(Source(path=place.as_posix()))
    return tuple(sources)


def _link_or_copy(source: str, target: str) -> None:
    try:
        os.link(os.path.realpath(source), target)
    except FileExistsError:  # of another setting's
        pass
    except OSError:  # another file system, or one without links
        shutil.copy2(source, target)
