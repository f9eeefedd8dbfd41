"""The result folder of a run: everything scored, then written."""

import shutil
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd

from handbench.bench import results
from handbench.bench.evaluation.error_causes import averaged_lines
from handbench.bench.evaluation.floor import budget
from handbench.bench.evaluation.metrics import TITLES
from handbench.bench.evaluation.rows import metric_facts
from handbench.bench.evaluation.scoring_protocols import protocol
from handbench.bench.evaluation.statistics.intervals import note
from handbench.bench.evaluation.statistics.sample_size import variance_facts
from handbench.bench.results import About, CaptureFacts, MethodFacts, Surface
from handbench.bench.results.tables import CAUSES, RELIABILITY, TASKS, frame
from handbench.bench.run import scoring
from handbench.bench.run.outcome import Basis, Outcome, basis, errors, repeated, surfaces
from handbench.bench.run.tabulation import kept, tables
from handbench.radar.imaging.device import describe
from handbench.support.cost import calibrated_machine
from handbench.support.files import atomic_path
from handbench.support.folder import drop
from handbench.support.progress import say
from handbench.support.store import versions

FILES = ("result.json", "config.toml", "errors", "depth", "photos", *(f"{name}.csv" for name in results.TABLES))


def write(folder: Path, outcome: Outcome, config: str) -> None:
    """Score everything, then write the result folder; earlier results give way only when the new ones stand, and
    result.json, which says that the folder is complete, comes last."""
    on = basis(outcome)
    if outcome.failures:
        say(f"the table stands on {on.text}")
    found = tables(outcome, on)
    drop(folder, FILES)
    for capture, entry in product(on.captures, on.methods):
        name = capture.name
        _copy(outcome.maps[name, entry.id], results.depth_path(folder, name, entry.id))
        for reference in outcome.references[name]:
            about_map = name, entry.id, reference
            _copy(results.errors_path(outcome.scores[name], *about_map), results.errors_path(folder, *about_map))
            if entry is on.methods[0]:  # references are drawn on the first method's grid
                on_grid = [name], entry.id, reference
                error, known = errors(outcome, *on_grid)[0], surfaces(outcome, *on_grid)[0]
                surface = Surface(error.x_m, error.y_m, known.z_m, known.sigma_m)
                results.write_surface(folder, name, reference, surface)
    for capture in on.captures:
        if capture.name in outcome.views:
            results.write_photo(folder, capture.name, outcome.views[capture.name])
    results.write_config(folder, config)
    names, methods = [capture.name for capture in on.repeated], [entry.id for entry in on.methods]
    repeats = repeated(outcome)
    repeats = repeats[repeats.capture.isin(names) & repeats.method.isin(methods)]
    found |= {"tasks": frame(TASKS, outcome.tasks), "repeats": repeats}
    for name, schema in (("causes", CAUSES), ("reliability", RELIABILITY)):
        lines = (line for capture in on.captures for line in kept(outcome, capture.name, scoring.CAUSES)[name])
        found[name] = averaged_lines((line for line in lines if line["method"] in methods), schema)
    results.write_tables(folder, **found)
    results.write_about(folder, about(outcome, on, found["captures"]))


def _copy(source: Path, path: Path) -> None:
    with atomic_path(path) as temporary:
        shutil.copyfile(source, temporary)


def about(outcome: Outcome, on: Basis, captures: pd.DataFrame) -> About:
    """Content of result.json; captures: the table of this name."""
    first = on.methods[0].id
    measured = [c.name for c in on.captures if "photogrammetry" in outcome.references[c.name]]
    budgets = dict(zip(measured, map(budget, surfaces(outcome, measured, first, "photogrammetry")), strict=True))
    return About(
        name=outcome.bench.name,
        protocol={
            **protocol(outcome.bench.protocol).about(),
            "basis": on.text,
            "repeats": outcome.bench.repeats,
            "seed": outcome.bench.seed,
        },
        metrics=metric_facts(),
        inputs=outcome.inputs,
        versions=versions(),
        machine=_machines(outcome),
        captures=tuple(
            CaptureFacts(
                name=capture.name,
                measures=capture.measures,
                pose=capture.about.pose,
                distance_m=capture.about.distance_m,
                references=tuple(outcome.references.get(capture.name, ())),
                effects=tuple(choice.model_dump(mode="json") for choice in capture.about.effects),
            )
            for capture in on.all_captures
        ),
        methods=tuple(
            MethodFacts(
                name=entry.id,
                title=TITLES.get(entry.id, entry.id),
                config={
                    c.name: outcome.configs[c.name, entry.id]
                    for c in on.all_captures
                    if (c.name, entry.id) in outcome.configs
                },
            )
            for entry in on.methods
        ),
        facts={
            **outcome.facts,
            "intervals": note(len(on.captures)),
            **({"variance_components": parts} if (parts := _variances(captures)) else {}),
            **({"groundtruth_sigma_rms": budgets} if budgets else {}),
            "phase_noise_rad": outcome.bench.phase_noise_rad,
        },
        failures=tuple(outcome.failures),
    )


def _variances(captures: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Variance components of every figure under equal treatment; nothing where there are too few captures."""
    alike = captures[captures.treatment != ""]
    found = {}
    for (metric, treatment), lines in alike.groupby(["metric", "treatment"], sort=False):
        by_method = {str(method): of.value.to_numpy() for method, of in lines.groupby("method", sort=False)}
        found[f"{metric}, {treatment}"] = variance_facts(by_method)
    return {name: parts for name, parts in found.items() if parts}


def _machines(outcome: Outcome) -> dict[str, Any]:
    """This machine and, where others did some of the work, they too."""
    here = calibrated_machine()
    others = {name: facts for name, facts in outcome.machines.items() if name != here["host"]}
    return {**here, "imaging_device": describe(), **({"others": others} if others else {})}
