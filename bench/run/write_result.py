"""Write the result folder of a run: the scores of the captures, the table made of them, and all
maps."""

import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench import results
from handbench.bench.evaluation.floor import budget
from handbench.bench.evaluation.intervals import note
from handbench.bench.evaluation.main_table import PER_PIXEL, STRONGEST, main_table
from handbench.bench.evaluation.metrics import pool
from handbench.bench.evaluation.scoring_protocols import protocol
from handbench.bench.evaluation.tables import SCORES, TASKS, frame, read
from handbench.bench.results import (
    About,
    CaptureFacts,
    Frames,
    MethodFacts,
    SurfaceMap,
    metric_facts,
)
from handbench.bench.results.derived import few_pixels, few_pixels_text
from handbench.bench.run import scoring
from handbench.bench.run.outcome import CommonSubset, Outcome, common_subset, surfaces
from handbench.bench.run.reconstruct_stage import VELOCITY, read_frames, read_times
from handbench.bench.run.repeat_stage import read_repeats
from handbench.radar.data.depthmap import load_depthmap
from handbench.radar.imaging.device import describe
from handbench.support.cost import calibrated_machine
from handbench.support.files import atomic_path
from handbench.support.folder import drop
from handbench.support.progress import say
from handbench.support.store import versions

FILES = (
    "result.json",
    "config.toml",
    "errors",
    "depth",
    "frames",
    "photos",
    *(f"{name}.csv" for name in results.TABLES),
)


def write(folder: Path, outcome: Outcome, config: str) -> None:
    """Collect the scores of all captures and methods of the table, and write the result folder.
    Earlier results are replaced only when the new ones are complete; result.json, which marks the
    folder as complete, is written last. config: text of config.toml. Raises HandbenchError if every
    capture failed."""
    on = common_subset(outcome)
    if outcome.failures:
        say(f"the table uses {on.text}")
    found = scores(outcome, on)
    bench, order = outcome.bench, [entry.id for entry in on.methods]
    table = main_table(
        # a stage's scores may be kept from a benchmark with another order of its methods
        found.sort_values("method", key=lambda ids: ids.map(order.index), kind="stable"),
        protocol(bench.protocol),
        bench.seed,
        bool(bench.reproduces),
    )
    drop(folder, FILES)
    for capture, entry in product(on.captures, on.methods):
        name = capture.name
        _copy(outcome.maps[name, entry.id], results.depth_path(folder, name, entry.id))
        if frames := _frames(outcome.maps[name, entry.id]):
            results.write_frames(folder, name, entry.id, frames)
        for reference in outcome.references[name]:
            about_map = name, entry.id, reference
            _copy(
                results.errors_path(outcome.scores[name], *about_map),
                results.errors_path(folder, *about_map),
            )
            if entry is on.methods[0]:  # references are drawn on the first method's grid
                error = results.read_errors(outcome.scores[name], *about_map)
                [known] = surfaces(outcome, [name], entry.id, reference)
                surface = SurfaceMap(error.x_m, error.y_m, known.z_m, known.sigma_m)
                results.write_surface(folder, name, reference, surface)
    for capture in on.captures:
        if capture.name in outcome.views:
            results.write_photo(folder, capture.name, outcome.views[capture.name])
    results.write_config(folder, config)
    facts = capture_facts(outcome, on)
    scored = [each for each in facts if "accuracy" in each.measures]
    if few := few_pixels_text(few_pixels(found, scored)):
        on = replace(on, text=f"{on.text}; {few}")
        say(few)
    tasks = frame(TASKS, outcome.tasks)
    results.write_tables(folder, table=table, tasks=tasks, scores=found)
    results.write_about(folder, about(outcome, on, facts))


def _copy(source: Path, path: Path) -> None:
    with atomic_path(path) as temporary:
        shutil.copyfile(source, temporary)


def _frames(first: Path) -> Frames | None:
    """Read the depths and velocities of all frames that an imaging stage has made; None if there is
    a single frame, or no velocities or times of the frames. first: depth map of the first frame."""
    maps, times_s = read_frames(first.parent, load_depthmap(first)), read_times(first.parent)
    if not maps or maps[0].velocity_m_s is None or "frame_times_s" not in times_s:
        return None
    z_m, velocity_m_s = (np.stack([getattr(m, n) for m in maps]) for n in ("z_m", VELOCITY))
    return Frames(
        maps[0].x_m, maps[0].y_m, z_m, velocity_m_s, np.array(times_s["frame_times_s"], np.float64)
    )


def scores(outcome: Outcome, on: CommonSubset) -> pd.DataFrame:
    """Collect the table of scores (SCORES) of the captures and methods that the result contains.
    Its lines are the figures of each capture, from its scoring stage; the time of each image; and
    for the precision, the depth of the strongest scatterer in each repeated frame, and the median
    over the pixels of their standard deviations."""
    methods, repeated = (
        [entry.id for entry in on.methods],
        [capture.name for capture in on.repeated],
    )
    rows: list[tuple[Any, ...]] = [
        (capture, method, "", "", repeat, STRONGEST, z_m)
        for capture, method, repeat, z_m in outcome.repeats
        if capture in repeated and method in methods
    ]
    for about_map in product(repeated, methods):
        if about_map in outcome.deviations:
            figures = pool([read_repeats(outcome.deviations[about_map])[1]])
            rows.append((*about_map, "", "", 0, PER_PIXEL, figures["median_mm"]))
    for about_map in product((capture.name for capture in on.all_captures), methods):
        seconds = outcome.seconds.get(about_map, [])
        rows += [
            (*about_map, "", "", number, "seconds", value) for number, value in enumerate(seconds)
        ]
    of_captures = [
        read(outcome.scores[capture.name] / scoring.SCORED, SCORES) for capture in on.captures
    ]
    found = pd.concat([frame(SCORES), *of_captures, frame(SCORES, rows)], ignore_index=True)
    return found[found.method.isin(methods)].reset_index(drop=True)


def capture_facts(outcome: Outcome, on: CommonSubset) -> tuple[CaptureFacts, ...]:
    """Return the facts of the result's captures that result.json records, such as pose and
    distance."""
    return tuple(
        CaptureFacts(
            name=capture.name,
            measures=capture.measures,
            pose=capture.about.pose,
            distance_m=capture.about.distance_m,
            references=tuple(outcome.references.get(capture.name, ())),
            effects=tuple(choice.model_dump(mode="json") for choice in capture.about.effects),
        )
        for capture in on.all_captures
    )


def about(outcome: Outcome, on: CommonSubset, captures: tuple[CaptureFacts, ...]) -> About:
    """Make the content of result.json: protocol, inputs, machine, captures, methods, facts,
    failures. captures: facts of the captures."""
    first = on.methods[0].id
    measured = [c.name for c in on.captures if "photogrammetry" in outcome.references[c.name]]
    budgets = dict(
        zip(
            measured, map(budget, surfaces(outcome, measured, first, "photogrammetry")), strict=True
        )
    )
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
        captures=captures,
        methods=tuple(
            MethodFacts(
                name=entry.label,
                id=entry.id,
                title=entry.title or entry.label,
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
            **({"groundtruth_sigma_rms": budgets} if budgets else {}),
            "phase_noise_rad": outcome.bench.phase_noise_rad,
        },
        failures=tuple(outcome.failures),
    )


def _machines(outcome: Outcome) -> dict[str, Any]:
    """Return facts of this machine and of all others that did some of the work."""
    here = calibrated_machine()
    others = {name: facts for name, facts in outcome.machines.items() if name != here["host"]}
    return {**here, "imaging_device": describe(), **({"others": others} if others else {})}
