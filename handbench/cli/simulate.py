"""`handbench simulate`: simulate the capture of a scene and print its table of effects, or simulate
all captures of a benchmark."""

import argparse
from pathlib import Path

from handbench.bench.benchmarks.benchmark_file import embedded_benchmarks
from handbench.bench.datasets.simulated import WRITTEN, simulate_capture
from handbench.bench.run.capture_set import BENCH, CAPTURES, simulate_benchmark
from handbench.bench.scenes.build import load_scene
from handbench.bench.scenes.echoes import explained
from handbench.bench.scenes.photographs import photo_effects
from handbench.cli.options import free_folder
from handbench.radar.simulation.known_effects import Choice
from handbench.support.config import read_toml
from handbench.support.errors import HandbenchError
from handbench.support.progress import counted


def run(options: argparse.Namespace) -> str | None:
    """Simulate a scene and write its capture, or all captures of a benchmark.
    With --explain, only print the physical effects that would be simulated: the size of each, and
    why it is on or off."""
    if _is_benchmark(options.scene):
        if options.explain or options.frames > 1 or options.out is None:
            raise HandbenchError(
                "simulate: a benchmark needs -o DIR and accepts neither --explain nor --frames; "
                "add -o DIR and leave these out, or name a scene file"
            )
        for capture in (options.out / CAPTURES).glob("[!.]*"):
            if options.overwrite:
                free_folder(capture, True, WRITTEN)
        count = simulate_benchmark(str(options.scene), options.out, options.overwrite)
        captures = f"{count} capture{'s' * (count > 1)}"
        print(f"{captures}: handbench run {options.out / BENCH} -o RESULT")
        return f"{options.out}: {captures} simulated"
    if options.explain:
        scene = load_scene(options.scene)
        of_photos = photo_effects(scene.file.photos) if scene.file.photos else ()
        show(explained(scene) + of_photos)
        return None
    if options.out is None:
        raise HandbenchError(
            "-o: is missing; add -o DIR for the capture folder, or use --explain without it"
        )
    free_folder(options.out, options.overwrite, WRITTEN)
    scene = load_scene(options.scene)
    with counted(1) as progress, progress.part(scene.file.name):
        effects = simulate_capture(scene, options.out, options.frames)
    show(effects)
    frames = f"{options.frames} frames of echoes" if options.frames > 1 else "echoes"
    photographs = f", {len(scene.cameras)} photographs" if scene.cameras else ""
    return f"{options.out}: {frames}{photographs}, {sum(row.on for row in effects)} effects on"


def _is_benchmark(path: Path) -> bool:
    """Tell whether a path is a benchmark and not a scene: a file that lists methods, or the name of
    a benchmark that is installed with handbench."""
    if not path.is_file():
        return str(path) in embedded_benchmarks()
    return "method" in read_toml(path, "a scene or a benchmark")


def show(rows: tuple[Choice, ...]) -> None:
    """Print a table of physical effects on stdout, with one row for each.
    The columns are its change of depths (mm), share of pixels lost or gained (%) and level (dB),
    whether it is on and why, and its computing time in seconds; those without any value are left
    out."""
    from handbench.reports.tables.result_tables import print_table, terminal_table

    columns = {
        "effect": [row.effect for row in rows],
        "depth mm": [_number(row.depth_mm, 3) for row in rows],
        "worst mm": [_number(row.worst_mm, 3) for row in rows],
        "pixel %": [_number(row.pixels_percent, 1) for row in rows],
        "level dB": [_number(row.level_db, 1) for row in rows],
        "on": ["on" if row.on else "–" for row in rows],
        "time s": [_number(row.seconds, 2) for row in rows],
        "why": [row.why for row in rows],
    }
    shown = {heading: cells for heading, cells in columns.items() if any(cells)}
    lines = list(zip(*shown.values(), strict=True))
    table = terminal_table("", tuple(shown), lines, texts=("effect", "on", "why"))
    table.collapse_padding = True
    print_table(table, piped=80)


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
