"""Content of the HTML report's sections, as tables and texts: results of the tests, simulated
effects, uncertainty of the ground truth, reliability of σ, and provenance."""

import json
from dataclasses import dataclass, replace
from typing import Any

from handbench.bench.evaluation.metrics import HEADLINE
from handbench.bench.evaluation.tables import each
from handbench.bench.results.about import TREATMENTS, on_common_pixels
from handbench.bench.results.result_folder import Result, best, shown
from handbench.reports.tables.blocks import rounded
from handbench.reports.tables.result_tables import claims
from handbench.reports.tables.rounding import NONE, number, p_text
from handbench.reports.tables.table import AGAINST, beside_paper


@dataclass(frozen=True)
class Grid:
    """A table for the HTML page: caption, headings, and rows of formatted cells. The first `texts`
    columns are text; the others are numbers, aligned right."""

    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    texts: int = 1

    @property
    def filled(self) -> "Grid":
        """The table without the columns that have no entry."""
        cells = [column for column in zip(*self.rows, strict=True)]
        kept = [i for i, column in enumerate(cells) if i == 0 or set(column) - {"", NONE}]
        return replace(
            self,
            headings=tuple(self.headings[i] for i in kept),
            rows=tuple(tuple(row[i] for i in kept) for row in self.rows),
            texts=sum(i < self.texts for i in kept),
        )


def verdicts(result: Result) -> tuple[Grid, list[Grid]]:
    """Return the results of the tests for each metric, reference surface and treatment that was
    compared: a table of the best methods with a row for each that was tested, and tables of all
    pairs of methods.
    (Treatment: depth maps with each method's own settings, or compared on common pixels, either all
    without smoothing or all with the same smoothing.)"""
    titles = result.about.method_titles
    found, pairs = [], []
    for _, lines in result.comparisons.groupby(["metric", "reference", "treatment"], sort=False):
        first = next(each(lines))
        metric, reference, treatment = first.metric, first.reference, first.treatment
        common = on_common_pixels(metric) if treatment else ""
        how = f", {TREATMENTS.get(treatment, treatment)}" if treatment else ""
        heading = f"{result.title(metric)}{common} {AGAINST.get(reference, reference)}{how}"
        rows = tuple((c.sentence, p_text(c.p_corrected), number(c.effect, 2)) for c in each(lines))
        caption = f"{heading}: every pair on {first.n_captures} captures"
        pairs.append(Grid(caption, ("difference", "p, corrected", "effect (dz)"), rows))
        names = sorted(best(lines), key=set(lines.worse).__contains__)
        if names:
            first, *equal = (titles.get(name, name) for name in names)
            differ = f"{int(shown(lines).sum())} of {len(rows)}"
            found.append((heading, first, ", ".join(equal) or NONE, differ))
    headings = ("figure", "best", "not shown to be better than", "pairs that differ")
    return Grid("Best methods", headings, tuple(found), texts=3), pairs


def findings(result: Result) -> Grid:
    """Return a table of the main pairs of methods under equal treatment: which one is better, and
    by how much."""
    headings = ("methods", "MAE on the pixels that all see")
    rows = tuple(claim[:2] for claim in claims(result))
    return Grid("Main pairs of methods, treated equally", headings, rows, texts=2)


def stage_times(result: Result) -> Grid:
    """Return a table of the cost of each processing stage of each method: number of tasks, how many
    were reused from an earlier run, and medians of seconds, CPU seconds and peak memory."""
    titles = result.about.method_titles | {"": "every method"}
    groups = result.tasks.groupby(["method", "stage"], sort=False)
    medians = groups[["seconds", "cpu_seconds", "peak_memory_mb"]].median().map(rounded)
    lines = groups.cached.agg(["size", "sum"]).join(medians).reset_index()
    lines["method"] = lines.method.replace(titles)
    rows = tuple(tuple(map(str, line)) for line in lines.itertuples(index=False, name=None))
    headings = (
        "method",
        "stage",
        "tasks",
        "of them cached",
        "seconds",
        "CPU seconds",
        "peak memory in MB",
    )
    caption = "Median of each stage's tasks; cached: the time was measured by an earlier run"
    return Grid(caption, headings, rows, texts=2)


def effects(result: Result) -> tuple[Grid | None, str]:
    """Return a table of the simulated physical effects that were on in a capture, and a sentence
    that names the others. The table has the largest values over the captures of an effect's size,
    where it is known, and its computing time; it is None if no effect was on."""
    by_effect: dict[str, list[dict[str, Any]]] = {}
    every = [row for capture in result.about.captures for row in capture.effects]
    for row in every:
        by_effect.setdefault(str(row.get("effect", "")), []).append(row)
    sizes = {"depth_mm": "changes depths by (mm)", "level_db": "level (dB)", "seconds": "took (s)"}
    shown = [key for key in sizes if any(row.get(key) is not None for row in every)]
    rows, off = [], []
    for name, found in by_effect.items():
        on = sum(bool(row.get("on")) for row in found)
        if not on:
            off.append(name)
            continue
        why = "; ".join(dict.fromkeys(str(row.get("why", "")) for row in found))
        largest = (_largest(found, key) for key in shown)
        rows.append((name, why, f"{on} of {len(found)}", *largest))
    caption = (
        "Effects of simulated echoes and photographs: largest size and seconds over the captures"
    )
    headings = ("effect", "why", "on in", *(sizes[key] for key in shown))
    grid = Grid(caption, headings, tuple(rows), texts=2) if rows else None
    return grid, f"Off: {', '.join(off)}." if off else ""


def _largest(rows: list[dict[str, Any]], key: str) -> str:
    values = [row[key] for row in rows if isinstance(row.get(key), int | float)]
    return rounded(max(values)) if values else NONE


def uncertainty(result: Result) -> list[Grid]:
    """Return tables of the uncertainty of the ground truth, as far as the result has the data.
    They are: for each capture, σ along z of the photogrammetric mesh and of its registration; the
    mean error that a perfect radar would show; and the residuals of the registration on the
    calibration target."""
    grids = []
    budgets = result.about.facts.get("groundtruth_sigma_rms")
    if isinstance(budgets, dict) and budgets:
        rows = tuple(
            (name, *(_mm(budget.get(key)) for key in ("mesh_mm", "registration_mm", "together_mm")))
            for name, budget in budgets.items()
            if isinstance(budget, dict)
        )
        caption = (
            "Standard deviation of the photogrammetric reference along z: root mean square "
            "over its pixels"
        )
        grids.append(
            Grid(caption, ("capture", "mesh (mm)", "registration (mm)", "together (mm)"), rows)
        )
    floors = []
    for method in result.about.methods:
        found = [result.row("floor_mm", method.name, reference) for reference in AGAINST]
        if any(found):
            floors.append((method.title, *(rounded(row.value) if row else NONE for row in found)))
    if floors:
        headings = ("method", *(f"{against} (mm)" for against in AGAINST.values()))
        caption = (
            f"Ground-truth floor: the {result.title(HEADLINE)} that a perfect radar would show"
        )
        grids.append(Grid(caption, headings, tuple(floors)))
    residuals = result.about.facts.get("registration_residuals_mm")
    if isinstance(residuals, list) and residuals:
        at_hand = (
            "error at the captures' place",
            _mm(result.about.facts.get("registration_error_at_hand_mm")),
        )
        rows = (*((f"marker {i}", _mm(value)) for i, value in enumerate(residuals, 1)), at_hand)
        grids.append(Grid("Registration on the calibration target", ("residual of", "mm"), rows))
    return grids


def _mm(value: Any) -> str:
    return rounded(value) if isinstance(value, int | float) else NONE


def provenance(result: Result) -> list[tuple[str, Any]]:
    """Return facts on where a result comes from, as pairs (heading, name → value): protocol, noise
    and ground truth, versions, and machine. Empty ones are left out."""
    about = result.about
    elsewhere = {
        "groundtruth_sigma_rms",
        "registration_residuals_mm",
        "registration_error_at_hand_mm",
        "command",
    }
    facts = {name: fact for name, fact in about.facts.items() if name not in elsewhere}
    headings = ("Protocol", "Noise and ground truth", "Versions", "Machine")
    papers = () if beside_paper(result) else ("source", "setting")  # what the paper had
    protocol = {name: fact for name, fact in about.protocol.items() if name not in papers}
    parts = zip(headings, (protocol, facts, about.versions, about.machine), strict=True)
    return [(heading, facts) for heading, facts in parts if facts]


def captures(result: Result) -> Grid:
    """Return a table of the captures: name, pose, what each measures (accuracy, precision), the
    reference surfaces with which its depths are compared, and its distance in metres."""
    rows = tuple(
        (
            c.name,
            c.pose or NONE,
            ", ".join(c.measures),
            ", ".join(c.references) or NONE,
            number(c.distance_m, 3),
        )
        for c in result.about.captures
    )
    caption = "Captures"
    if len(rows) > len(result.scored()):
        caption += "; those that only measure the precision are not scored and have no pictures"
    headings = ("capture", "pose", "measures", "scored against", "distance (m)")
    return Grid(caption, headings, rows, texts=4)


def settings(result: Result) -> list[tuple[str, list[tuple[str, Any]]]]:
    """Return the complete settings of each method, as pairs (title of the method, entries). An
    entry is (names of captures, settings); captures with the same settings share one entry."""
    found = []
    for method in result.about.methods:
        groups: dict[str, tuple[list[str], Any]] = {}
        for capture, config in method.config.items():
            groups.setdefault(json.dumps(config, sort_keys=True, default=str), ([], config))[
                0
            ].append(capture)
        every = len(groups) == 1 and len(method.config) > 1
        entries = [
            ("all captures" if every else ", ".join(names), config)
            for names, config in groups.values()
        ]
        found.append((method.title, entries))
    return found


def command(result: Result) -> str:
    """Return the two command lines that repeat the run and its report. The first is the recorded
    one or, if none was recorded, a general form with placeholders."""
    recorded = result.about.facts.get("command")
    run = recorded if isinstance(recorded, str) else "handbench run BENCH.toml -o DIR"
    return f"{run}\nhandbench report DIR -o REPORT"


def reliability(result: Result) -> list[Grid]:
    """Return a table for each reference surface that shows whether the methods' predicted σ is
    right: the observed coverage in % under each nominal one."""
    grids, titles = [], result.about.method_titles
    for reference, lines in result.reliability.groupby("reference", sort=False):
        shares = lines.pivot(index="method", columns="nominal_percent", values="observed_percent")
        rows = tuple(
            (titles[name], *(number(share, 1) for share in shares.loc[name]))
            for name in dict.fromkeys(lines.method)
        )
        caption = f"Share of the errors inside the intervals of σ, {AGAINST[str(reference)]}"
        headings = ("method", *(f"nominal {percent} %" for percent in shares))
        grids.append(Grid(caption, headings, rows))
    return grids
