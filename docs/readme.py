"""Write the tables of README.md and docs/results.md from a result, and check whether they are out
of date.

    python -m docs.readme [RESULT] --check   do the pages agree with the record (and with RESULT)?
    python -m docs.readme RESULT --write     renew the tables, their record docs/table.json, and
                                             the figure

The record has the figures of the tables and what they were made from. The tables in the pages must
be exactly what is made from the record; the figure and the scene files must be those whose hashes
the record has. A new result must agree with the record within one unit of the last printed digit.
Times are not compared, because they depend on the machine.
"""

import argparse
import hashlib
import json
import re
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from handbench.bench.evaluation.tables import EQUAL as EQUAL_TABLE
from handbench.bench.evaluation.tables import TABLE, each, frame, records
from handbench.bench.results import HEADLINE, Result, load
from handbench.bench.results.about import SHARES, TREATMENTS, on_common_pixels
from handbench.reports.figures.depth_maps import depth_maps
from handbench.reports.figures.style import STYLE, save
from handbench.reports.tables.blocks import (
    NONE,
    busy_note,
    decimals,
    interval,
    is_known,
    number,
    outstanding,
    paper,
)
from handbench.reports.tables.result_tables import bold, escaped, findings, table
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text

ROOT = Path(__file__).parents[1]
REFERENCE = "photogrammetry"
METRICS = (HEADLINE, *SHARES, "floor_mm", "max_mm", "precision_mm", "seconds")
SPREAD = {
    "max_mm": "frames_max_deviation_mm"
}  # figures that stand with their deviation between frames
EXTENDED = ("max_mm",)  # those that stand against the completed reference as well
EQUAL = {
    "none": ("common_percent", HEADLINE, "aurc_mm"),
    "window": (HEADLINE, "aurc_mm"),
}  # by treatment
WITH_INTERVAL = (HEADLINE, "floor_mm", "precision_mm")
METHODS = (
    "2fsk",
    "3fsk",
    "broadband",
    "narrowband",
    "nfsk-plus",
    "joint",
    "broadband-aligned",
)  # the columns
FITTED = ("precision_mm", "2fsk")  # the figure to which the benchmark's phase noise was fitted
FIGURE, POSE = "docs/depth_F.png", "F"  # the README's figure, and the capture that it shows
SHOWN = ("2fsk", "3fsk", "broadband")  # its methods: few, so that it can be read at page width
MACHINE = ("processor", "cores", "memory_gb", "gemm_gflops", "imaging_device")
SCENES = "bench/run/benchmarks"
BLOCK = re.compile(r"(<!-- table: begin -->\n)(.*?)(<!-- table: end -->)", re.DOTALL)


def record(result: Result, root: Path = ROOT) -> dict[str, Any]:
    """Return the content of docs/table.json: the figures of the tables, and what they were made
    from.
    root: of the repository. Raises HandbenchError for a result that is not one of the benchmark
    paper_table."""
    shown = [(metric, REFERENCE) for metric in (*METRICS, *SPREAD.values())]
    shown += [(metric, "completed") for metric in EXTENDED]
    rows = [
        result.row(metric, method, reference) for metric, reference in shown for method in METHODS
    ]
    lines, titles = (frame(TABLE, filter(None, rows)), result.about.method_titles)
    equal = result.equal[result.equal.method.isin(METHODS)]
    undefined = {metric for metric, _ in shown} - result.about.metrics.keys()
    if undefined or lines.value.isna().all():
        raise HandbenchError(
            f"{result.folder}: has no figure of the README's table; expected a run of paper_table"
        )
    pairs = [
        (metric, treatment)
        for treatment, metrics in EQUAL.items()
        for metric in metrics
        if len(result.equal)
    ]
    best_equal = {
        f"{metric}, {treatment}": sorted(
            outstanding(result, metric, result.equal.reference.iloc[0], treatment)
        )
        for metric, treatment in pairs
    }
    return {
        "name": result.about.name,
        "protocol": {key: result.about.protocol.get(key) for key in ("id", "version")},
        "config": result.config,
        "scenes": _scenes(root, result.config),
        "machine": {key: result.about.machine.get(key) for key in MACHINE},
        "versions": result.about.versions,
        "metrics": {
            key: result.about.metrics[key].model_dump() for key in {*METRICS, *equal.metric}
        },
        "titles": [titles.get(method, method) for method in METHODS],
        "busy": busy_note(result),
        "rows": records(lines),
        "equal": records(equal),
        "best": {metric: sorted(outstanding(result, metric, REFERENCE)) for metric in METRICS}
        | best_equal,
        "sentences": findings(result),
        "figures": {FIGURE: _sha256(root / FIGURE)},
    }


def render_own(recorded: dict[str, Any]) -> str:
    """Return the text between the README's markers: a table of the methods with their own settings,
    and notes.
    recorded: content of docs/table.json."""
    machine = recorded["machine"]
    device = (
        "no GPU" if machine["imaging_device"] == "cpu" else f"imaged on {machine['imaging_device']}"
    )
    return (
        table(("", *recorded["titles"]), _own_lines(recorded))
        + "\nAgainst photogrammetry, as in the paper: each figure is formed for each pose and "
        "then averaged, on the "
        "pixels that the method itself sees.\nIn italics the paper's figure; ± the deviation "
        "between frames; in "
        "brackets a 95 % confidence interval, where there is one (of the precision: for "
        "further\nrepeats of these "
        "hands; three poses are too few to tell how others differ). "
        f"{machine['cores']} cores of an {escaped(str(machine['processor']))}, {escaped(device)}."
        f"{' ' if recorded['busy'] else ''}{escaped(recorded['busy'])}\n"
    )


def render_equal(recorded: dict[str, Any]) -> str:
    """Return the text between the markers of docs/results.md: a table of the methods under equal
    treatment (same smoothing, common pixels), and findings.
    recorded: content of docs/table.json."""
    sentences = "".join(f"- {escaped(sentence)}.\n" for sentence in recorded["sentences"])
    return table(("", *recorded["titles"]), _equal_lines(recorded)) + (
        f"\n{sentences}" if sentences else ""
    )


PAGES: dict[str, Callable[[dict[str, Any]], str]] = {
    "README.md": render_own,
    "docs/results.md": render_equal,
}


def _own_lines(recorded: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield the rows of the table of methods with their own settings, each as its cells."""
    rows = _figures(recorded)
    for metric in METRICS:
        facts, stars = recorded["metrics"][metric], recorded["best"][metric]
        for reference in (REFERENCE, "completed") if metric in EXTENDED else (REFERENCE,):
            cells = []
            for method in METHODS:
                cell = _cell(rows.get((metric, reference, method)), method in stars)
                spread = rows.get((SPREAD.get(metric, ""), reference, method))
                cells.append(
                    f"{cell} ± {number(spread.value, 1)}"
                    if spread and is_known(spread.value)
                    else cell
                )
            title = facts["title"] + (
                ", mesh completed by the truth" if reference == "completed" else ""
            )
            yield (f"{title} ({facts['unit']})", *cells)


def _equal_lines(recorded: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield the rows of the table of methods under equal treatment (same smoothing, common pixels),
    each as its cells."""
    rows = _figures(recorded)
    for treatment, metrics in EQUAL.items():
        for metric in metrics:
            found = [rows.get((metric, treatment, method)) for method in METHODS]
            if any(found):
                facts = recorded["metrics"][metric]
                how = "" if facts["unit"] == "%" else f", {TREATMENTS[treatment]}"
                stars = recorded["best"][f"{metric}, {treatment}"]
                cells = (_cell(row, row is not None and row.method in stars) for row in found)
                yield (f"{facts['title']}{on_common_pixels(metric)}{how} ({facts['unit']})", *cells)


def _figures(recorded: dict[str, Any]) -> dict[tuple[str, str, str], Any]:
    """Index the recorded figures: (metric, reference, method) → line. Under equal treatment, the
    treatment is in place of the reference."""
    own = {
        (row.metric, row.reference, row.method): row for row in each(frame(TABLE, recorded["rows"]))
    }
    equal = each(frame(EQUAL_TABLE, recorded["equal"]))
    return own | {(row.metric, row.treatment, row.method): row for row in equal}


def _cell(row: Any, star: bool) -> str:
    if row is None or not is_known(row.value):
        return NONE
    places = decimals(row.value, row.low, row.high, row.unit)
    value = number(row.value, places)
    parts = [bold(value) if star else value]
    if (row.metric, row.method) == FITTED:
        parts.append("(fitted)")
    elif row.metric in WITH_INTERVAL:
        parts.append(escaped(interval(row.low, row.high, places)))
    if is_known(getattr(row, "paper", None)):
        parts.append(f"*{paper(row.paper, row.unit)}*")
    return " ".join(filter(None, parts))


def write(result: Result, root: Path = ROOT) -> None:
    """Write docs/table.json, the tables in the pages, and the figure.
    root: of the repository. Raises HandbenchError for a result that is not one of the benchmark
    paper_table."""
    texts = {page: _page(root / page) for page in PAGES}
    save(draw(result), root / FIGURE)
    recorded = record(result, root)
    write_text(root / "docs/table.json", json.dumps(recorded, indent=1, ensure_ascii=False) + "\n")
    for page, rendered in PAGES.items():
        shown = rendered(recorded)
        write_text(root / page, BLOCK.sub(lambda m, shown=shown: m[1] + shown + m[3], texts[page]))


def draw(result: Result) -> Figure:
    """Draw the README's figure: photograph, ground truth, and the depths and errors of the methods
    SHOWN, of the capture POSE. Raises HandbenchError if the result lacks this capture."""
    found = [capture for capture in result.about.captures if capture.name == POSE]
    if not found:
        raise HandbenchError(
            f"{result.folder}: lacks capture {POSE}; expected a run of paper_table"
        )
    methods = tuple(method for method in result.about.methods if method.name in SHOWN)
    shown = replace(result, about=result.about.model_copy(update={"methods": methods}))
    with matplotlib.rc_context(STYLE):
        return depth_maps(shown, found[0], REFERENCE).figure


def stale(root: Path = ROOT) -> list[str]:
    """Return a sentence for everything in the repository that does not agree with docs/table.json:
    tables, figures and scene files."""
    recorded = _recorded(root)
    problems = [
        f"{page}: the table is not what docs/table.json says"
        for page, rendered in PAGES.items()
        if BLOCK.findall(_page(root / page))[0][1] != rendered(recorded)
    ]
    for name, digest in recorded["figures"].items():
        if _sha256(root / name) != digest:
            problems.append(f"{name}: is not the figure that came with the table")
    scenes = _scenes(root, recorded["config"])
    changed = (name for name, meaning in recorded["scenes"].items() if scenes[name] != meaning)
    problems += [f"{SCENES}/{name}: has changed since the table was made" for name in changed]
    return problems


def disagreements(result: Result, root: Path = ROOT) -> list[str]:
    """Return a sentence for each figure of a new result that differs from the recorded one by more
    than one unit of the last printed digit. Times are not compared."""
    recorded, fresh = _recorded(root), record(result, root)
    problems, rows = [], _figures(fresh)
    for (metric, kind, method), old in _figures(recorded).items():
        new, how = rows.pop((metric, kind, method), None), f", {kind}," if kind in EQUAL else ""
        if metric in EQUAL.get(kind, (metric,)) and metric != "seconds" and not _agree(old, new):
            found = None if new is None else new.value
            problems.append(f"{metric}{how} of {method}: {old.value} was recorded, {found} found")
    unknown = [
        (metric, method)
        for metric, kind, method in rows
        if metric != "seconds" and kind not in EQUAL
    ]
    problems += [f"{metric} of {method}: was not recorded" for metric, method in unknown]
    if fresh["best"] != recorded["best"]:
        problems.append(f"best: {recorded['best']} was recorded, {fresh['best']} found")
    return problems


def _agree(old: Any, new: Any) -> bool:
    if new is None or not (is_known(old.value) and is_known(new.value)):
        return new is not None and is_known(old.value) == is_known(new.value)
    return abs(new.value - old.value) <= 10.0 ** -decimals(old.value, old.low, old.high, old.unit)


def _recorded(root: Path) -> dict[str, Any]:
    try:
        return json.loads((root / "docs/table.json").read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise HandbenchError(
            f"{root / 'docs/table.json'}: cannot be read ({error}); make it with --write"
        ) from None


def _page(file: Path) -> str:
    text = file.read_text("utf-8")
    if len(BLOCK.findall(text)) != 1:
        raise HandbenchError(
            f"{file}: lacks its one pair of lines <!-- table: begin -->, … end -->"
        )
    return text


def _scenes(root: Path, config: str) -> dict[str, str]:
    """Compute a hash of each scene file of the benchmark, without its comments: file name → hash,
    "" if there is no such file.
    config: the benchmark as TOML text."""
    described = tomllib.loads(config)
    sources = [*described.get("calibration", ()), *described.get("capture", ())]
    hashes = {source["scene"]: "" for source in sources if "scene" in source}
    for name in hashes:
        scene = root / SCENES / name
        if scene.is_file():
            meaning = json.dumps(tomllib.loads(scene.read_text("utf-8")), sort_keys=True)
            hashes[name] = hashlib.sha256(meaning.encode()).hexdigest()
    return hashes


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def main(arguments: list[str] | None = None) -> int:
    """Check or renew the tables, as the command line asks. Prints a line for each problem; returns
    the exit code, 1 if there is any, and 2 for an error."""
    parser = argparse.ArgumentParser(
        prog="python -m docs.readme", description="tables of README and docs/results.md"
    )
    parser.add_argument(
        "result", type=Path, nargs="?", metavar="RESULT", help="folder of a run of paper_table"
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--check", action="store_true", help="are they stale?")
    what.add_argument("--write", action="store_true", help="renew them")
    options = parser.parse_args(arguments)
    try:
        if options.write:
            if options.result is None:
                raise HandbenchError("RESULT: is missing; name the folder of a run of paper_table")
            write(load(options.result))
        problems = stale() + (disagreements(load(options.result)) if options.result else [])
    except HandbenchError as error:
        print(f"handbench: {error}", file=sys.stderr)
        return 2
    fine = "README.md and docs/results.md: the tables are up to date"
    if options.result:
        fine += (
            f", and {options.result} differs by at most one unit of the last digit (times are not "
            "compared)"
        )
    print("\n".join(problems) or fine)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
