"""Content of the report's folded details: simulated effects, uncertainty of the ground truth,
reliability of σ, times, definitions, provenance and settings."""

import json
from collections.abc import Mapping
from typing import Any

import pandas as pd

from handbench.bench.results.about import MethodFacts
from handbench.bench.results.result_folder import Result
from handbench.reports.tables.rounding import NONE, figure
from handbench.reports.tables.table import Table, against

Content = Table | str | Mapping[str, Any]  # a table, preformatted text, or facts by their names
EFFECT_SIZES = {  # of a simulated effect: its heading and unit
    "depth_mm": ("changes depths by (mm)", "mm"),
    "level_db": ("level (dB)", "dB"),
    "seconds": ("took (s)", "s"),
}
UNCERTAINTY = (  # facts with a section of their own
    "groundtruth_sigma_rms",
    "registration_residuals_mm",
    "registration_error_at_hand_mm",
)


def details(result: Result) -> dict[str, list[Content]]:
    """Return the folded parts at the end of a report: heading → content, without empty parts."""
    about = result.about
    provenance = {
        "Run": {key: fact for key, fact in about.facts.items() if key not in UNCERTAINTY},
        "Protocol": about.protocol,
        "Versions": about.versions,
        "Machine": about.machine,
    }
    parts: dict[str, list[Content]] = {
        "Effects of the simulation": effects(result),
        "Uncertainty of the ground truth and of the maps": uncertainty(result),
        "Where the time goes": stage_times(result),
        "Definitions of the metrics": [definitions(result)],
        "Provenance": [provenance, captures(result)],
        "Methods and their settings": [{m.title: settings(m) for m in about.methods}],
        "Inputs (SHA-256)": [about.inputs],
        "Resolved configuration": [result.config],
    }
    return {heading: content for heading, content in parts.items() if content}


def effects(result: Result) -> list[Content]:
    """Return a table of the simulated physical effects: in how many captures each was on, and the
    largest values over the captures of its size, where it is known, and of its computing time."""
    facts = [dict(effect) for capture in result.about.captures for effect in capture.effects]
    if not facts:
        return []
    lines = pd.DataFrame(facts, columns=["effect", "why", "on", *EFFECT_SIZES])
    groups = lines.groupby("effect", sort=False)
    texts = pd.DataFrame(
        {
            "why": groups.why.unique().map("; ".join),
            "on in": groups.on.agg(lambda on: f"{sum(on)} of {len(on)}"),
        }
    )
    for key, (heading, unit) in EFFECT_SIZES.items():
        largest = groups[key].max()
        if largest.notna().any():
            texts[heading] = [figure(size, unit=unit) for size in largest]
    caption = "Largest size and computing time over the captures"
    return [Table(caption, texts.rename_axis("effect"), left=1)]


def uncertainty(result: Result) -> list[Content]:
    """Return what the result says about the uncertainty of the ground truth: σ along z of the
    measured mesh and of its registration, for each capture; the residuals of the
    registration on the calibration target; and for each reference surface a table that shows
    whether the methods' predicted σ is right."""
    budgets, residuals_mm, at_hand_mm = (result.about.facts.get(name) for name in UNCERTAINTY)
    content: list[Content] = []
    if budgets:
        caption = "σ of the measured reference along z, root mean square over its pixels"
        sigmas = pd.DataFrame(budgets).T.drop(columns="unknown", errors="ignore")
        sigmas = sigmas.rename_axis("capture")
        sigmas.columns = sigmas.columns.str.replace("_mm", " (mm)")
        content.append(Table(caption, sigmas.map(_mm)))
    if residuals_mm:
        content.append(
            {
                "registration on the calibration target: residuals of the markers in mm": [
                    *map(_mm, residuals_mm)
                ],
                "its error at the captures' place in mm": _mm(at_hand_mm),
            }
        )
    for reference, lines in result.reliability.groupby("reference", sort=False):
        shares = lines.pivot(index="method", columns="nominal_percent", values="observed_percent")
        texts = shares.loc[lines.method.unique()].map(lambda share: figure(share, unit="%"))
        texts.columns = [f"nominal {percent} %" for percent in shares]
        caption = (
            f"Share of the errors inside the intervals of σ, {against(result, str(reference))}"
        )
        content.append(Table(caption, texts.rename(result.about.method_titles)))
    return content


def _mm(value: float | None) -> str:
    return figure(value, unit="mm")


def stage_times(result: Result) -> list[Content]:
    """Return a table of the cost of each processing stage of each method: number of tasks, how many
    were reused from an earlier run, and medians of seconds, CPU seconds and peak memory."""
    headings = {"seconds": "seconds", "cpu_seconds": "CPU seconds", "peak_memory_mb": "MB at most"}
    groups = result.tasks.groupby(["method", "stage"], sort=False)
    medians = groups[list(headings)].median().rename(columns=headings)
    texts = medians.map(lambda value: figure(value))
    texts.insert(0, "of them cached", groups.cached.sum().map(str))
    texts.insert(0, "tasks", groups.size().map(str))
    texts = texts.rename(result.about.method_titles | {"": "every method"}, level="method")
    caption = "Median of each stage's tasks; cached: the time was measured by an earlier run"
    return [Table(caption, texts.reset_index("stage"), left=1)] if len(texts) else []


def definitions(result: Result) -> Table:
    """Return a table of the metrics: title, unit, better values and definition."""
    facts = {metric.title: metric.model_dump() for metric in result.about.metrics.values()}
    texts = pd.DataFrame(facts).T[["unit", "better", "definition"]].rename_axis("metric")
    caption = (
        "Intervals are 95 % confidence intervals: of the mean over captures, with at least five; "
        "of the precision, the χ² interval of a standard deviation; of the time, by bootstrap"
    )
    return Table(caption, texts, left=3)


def captures(result: Result) -> Table:
    """Return a table of the captures: pose, what each measures (accuracy, precision), the reference
    surfaces with which its depths are compared, and its distance."""
    rows = {
        c.name: {
            "pose": c.pose or NONE,
            "measures": ", ".join(c.measures),
            "scored against": ", ".join(c.references) or NONE,
            "distance (m)": figure(c.distance_m),
        }
        for c in result.about.captures
    }
    return Table("Captures", pd.DataFrame(rows).T.rename_axis("capture"), left=3)


def settings(method: MethodFacts) -> dict[str, Any]:
    """Return the complete settings of a method: names of captures → settings. Captures with the
    same settings share one entry."""
    groups: dict[str, list[str]] = {}
    for capture, config in method.config.items():
        groups.setdefault(json.dumps(config, sort_keys=True), []).append(capture)
    if len(groups) == 1:
        return {"every capture": config}
    return {", ".join(names): method.config[names[0]] for names in groups.values()}
