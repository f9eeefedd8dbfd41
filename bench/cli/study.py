"""`handbench study NAME`: the studies that there are, their options, and how one is run."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from radar.support.errors import HandbenchError

HELP = "one of the studies behind the documentation's figures: cases → tables and a figure"


@dataclass(frozen=True)
class Entry:
    """A study: where its description is (a module of bench.studies), what it measures, and its options."""

    module: str
    text: str
    options: dict[str, dict[str, Any]] = field(default_factory=dict)


STUDIES = {
    "engine": Entry(
        "engine.measure",
        "what imaging and simulation cost in time, error and memory, and how that grows",
        {
            "--quick": {"action": "store_true", "help": "a small volume, in less than a minute: does it all run?"},
            "--full": {"action": "store_true", "help": "measure the exact volume whole instead of extrapolating"},
        },
    ),
    "ablation": Entry(
        "ablation.measure",
        "what each effect of simulated echoes does to each method, and what it costs",
        {
            "--poses": {"default": "B,F,U", "help": "letters, separated by commas (default B,F,U)"},
            "--frames": {"type": int, "default": 10, "help": "repeats for the precision (default 10)"},
        },
    ),
    "auto": Entry(
        "ablation.auto",
        'what effects = "auto" chooses on scenes that differ in kind, against all effects on',
        {
            "scenes": {"nargs": "*", "type": Path, "metavar": "SCENE.toml", "help": "default: five embedded ones"},
            "--tolerances": {"default": "0.1,1", "help": "of auto, mm, separated by commas (default 0.1,1)"},
        },
    ),
    "photogrammetry": Entry(
        "photogrammetry.measure",
        "what photogrammetry's accuracy costs in time, and whether its error bars are honest, on rendered hands",
        {
            "what": {"choices": ("bars", "sweep"), "help": "what a ground truth is held to, or its price in time"},
            "--poses": {"default": "C,Y", "help": "letters, separated by commas; sweep takes the first"},
        },
    ),
    "registration": Entry(
        "registration.measure",
        "how well the calibration target joins the sensors' frames, in placements whose truth is known",
        {
            "what": {"choices": ("full", "faults"), "help": "photographs too, or many placements with faults"},
            "--trials": {"type": int, "help": "placements (default 20 and 200)"},
        },
    ),
    "overhead": Entry(
        "overhead",
        "what the runner itself costs: tasks that do nothing, and a table of as many captures",
        {
            "--captures": {"type": int, "default": 1000, "help": "default 1000"},
            "--scheduler": {"metavar": "tcp://HOST:PORT", "help": "a Dask scheduler in place of this process"},
        },
    ),
    "smoothness": Entry(
        "smoothness",
        "how smooth a meshed hand is to the radar",
        {
            "letters": {"nargs": "?", "default": "", "help": "poses, as BFU (default: all)"},
            "--edge-mm": {"type": float, "default": 1.0, "help": "of the mesh's facets (default 1)"},
        },
    ),
    "noise-fit": Entry(
        "noise_fit",
        "the one fitted number: the phase noise at which 2-FSK has a given precision",
        {
            "benchmark": {"metavar": "BENCH.toml", "help": "benchmark file, or the name of an embedded one"},
            "--precision-mm": {"type": float, "default": 3.6, "help": "default 3.6, the paper's"},
            "--repeats": {"type": int, "help": "draws of the noise (default: the benchmark's)"},
        },
    ),
    "gpu": Entry(
        "gpu_benchmark",
        "what imaging costs on a CUDA device, copies to and from it included",
        {
            "--device": {"choices": ("cuda", "cpu", "numpy"), "default": "cuda", "help": "default cuda"},
            "--repeats": {"type": int, "default": 10, "help": "timings after the first (default 10)"},
        },
    ),
}


def add_arguments(command: argparse.ArgumentParser) -> None:
    """A parser for each study."""
    command.add_argument("--list", action="store_true", help="print the studies that there are, and stop")
    studies = command.add_subparsers(dest="study", metavar="NAME")
    for name, entry in STUDIES.items():
        parser = studies.add_parser(name, help=entry.text, description=entry.text)
        for option, settings in entry.options.items():
            parser.add_argument(option, **settings)
        out = f"folder, or FILE.json beside which the page stands (default runs/{name})"
        parser.add_argument("-o", "--out", type=Path, metavar="DIR", help=out)
        parser.add_argument("--only", default="", metavar="TEXT", help="the cases whose name holds TEXT")


def run(options: argparse.Namespace) -> None:
    """Measure, print the tables, write the files; a case that fails ends with exit code 2."""
    if options.list or options.study is None:
        print("\n".join(f"{name:<16}{entry.text}" for name, entry in STUDIES.items()))
        return
    from bench.studies import study

    entry = STUDIES[options.study]
    given = {_key(option): getattr(options, _key(option)) for option in entry.options}
    out = options.out or Path("runs") / options.study
    work = (out.parent if out.suffix == ".json" else out) / "work"
    chosen = import_module(f"bench.studies.{entry.module}").study(work=work, **given)
    found = study.run(chosen, out, _command(options.study, entry, given), options.only)
    print(found.markdown())
    print(f"study: {out}")
    chosen.check(found.frames)
    if found.failures:
        raise HandbenchError(f"study {options.study}: {len(found.failures)} of {len(chosen.cases)} cases failed")


def _key(option: str) -> str:
    return option.lstrip("-").replace("-", "_")


def _command(name: str, entry: Entry, given: dict[str, Any]) -> str:
    """The command that does this again."""
    words = ["handbench study", name]
    for option, settings in entry.options.items():
        value = given[_key(option)]
        if value in (settings.get("default"), None, False, []):
            continue
        shown = " ".join(map(str, value)) if isinstance(value, list) else str(value)
        words.append(shown if not option.startswith("-") else option if value is True else f"{option} {shown}")
    return " ".join(words)
