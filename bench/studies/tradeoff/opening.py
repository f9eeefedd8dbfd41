"""The captures of a trade-off and what they are scored against: the true surface, where all have one; its
sections, what each is held to (sections.toml), and one setting as a line of tradeoff.csv."""

import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.evaluation.intervals import Interval
from handbench.bench.results import Failure, Section, Setting
from handbench.bench.run.benchmark_file import BenchFile
from handbench.bench.run.executors import Here
from handbench.bench.run.jobs import references
from handbench.bench.run.outcome import Capture, Outcome, failing
from handbench.bench.run.runner import Run
from handbench.bench.run.sweep import SectionName
from handbench.support.errors import HandbenchError


@dataclass(frozen=True)
class Context:
    """bench: the benchmark, whose paths start from `base`; work: the claimed folder for kept stages; captures: opened,
    folders with echoes, photographs and truth as far as they have them; repeats: timed rounds, interleaved."""

    bench: BenchFile
    base: Path
    work: Path
    captures: list[Capture]
    seed: int
    repeats: int


def section(name: SectionName, reference: str, words: dict[str, Any], **known: str) -> Section:
    """The section of sections.toml; words: fill in its definition; known: what is not there."""
    about = tomllib.loads(Path(__file__).with_name("sections.toml").read_text("utf-8"))[name]
    about["definition"] = about["definition"].format(**words)
    return Section(name=name, reference=reference, **about, **known)


def line(
    of: Section,
    name: str,
    title: str,
    knobs: dict[str, Any],
    error: float | None = None,
    interval: Interval | None = None,
    seconds: Sequence[float] = (),
    **known: float | None,
) -> Setting:
    """The setting's line; one time has no range, and no time is None. Its rank, `answer.rank` fills in."""
    low, high = interval or (None, None)
    times = {"seconds": float(np.median(seconds)) if len(seconds) else None}
    if len(seconds) > 1:
        times |= {"seconds_low": float(min(seconds)), "seconds_high": float(max(seconds))}
    texts = {"section": of.name, "name": name, "title": title, "metric": of.metric, "unit": of.unit}
    knobs_json = json.dumps(knobs, ensure_ascii=False)
    return Setting(**texts, knobs=knobs_json, error=error, low=low, high=high, **{**times, **known})


@dataclass(frozen=True)
class Opened:
    """found: captures, references and failures of a run without methods; reference: the name of what scores all;
    targets: the calibration's captures, where photographs have to score."""

    found: Outcome
    reference: str
    targets: list[Capture] = field(default_factory=list)

    @property
    def captures(self) -> list[Capture]:
        """Those that have the reference."""
        return [c for c in self.found.captures if self.reference in self.found.references.get(c.name, {})]


def opened(bench: BenchFile, base: Path, work: Path, photographed: int) -> Opened:
    """Open or simulate the captures, frame 0 alone; photographs become meshes only where they have to score. Stages
    that were done before are taken from `work`. Of scenes alone, which tell their true surface, no more than
    `photographed` are photographed. Raises HandbenchError where nothing is left to score."""
    sources = tuple(source for source in bench.capture if "accuracy" in source.measures)
    if all(source.scene is not None for source in sources):
        unseen = (source.model_copy(update={"photos": False}) for source in sources[photographed:])
        sources = (*sources[:photographed], *unseen)
    alone = bench.model_copy(update={"capture": sources, "method": (), "calibration": (), "tradeoff": None})
    job = Run(alone, base.resolve(), work.resolve(), Here())
    job.open()
    captures = job.found.captures
    if captures and all(open_capture(capture.folder).truth is not None for capture in captures):
        reference = "truth"
        for capture in captures:
            with failing(job.found.failures, capture.name, "references"):
                given = references(capture, None, None, job.found)
                job.found.references[capture.name] = {"truth": given["truth"]}
    else:
        whole = alone.model_copy(update={"calibration": bench.calibration})
        job, reference = Run(whole, base.resolve(), work.resolve(), Here()), "photogrammetry"
        job.open()
        job.inspect()
        stages = job.photographed()
        job.collect(stages, job.perform(stages))
        job.find_references()
        for name, files in list(job.found.references.items()):
            job.found.references[name] = {key: files[key] for key in files if key == reference}
            if not job.found.references[name]:
                job.found.failures.append(
                    Failure(capture=name, stage="references", message="has no photogrammetry, which scores the others")
                )
    ready = Opened(job.found, reference, job.targets)
    if not ready.captures:
        reason = job.found.failures[0].message if job.found.failures else "no capture has a reference"
        raise HandbenchError(f"every capture failed; the first: {reason}")
    return ready
