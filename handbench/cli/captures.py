"""`handbench simulate` and `import`: captures, of scenes and of other programs' data."""

import argparse
from pathlib import Path
from typing import Any

from handbench.bench.benchmarks.benchmark_file import embedded_benchmarks
from handbench.bench.datasets.dataset import IMPORTED, import_capture, open_capture
from handbench.bench.datasets.simulated import WRITTEN, simulate_capture
from handbench.bench.run.capture_set import BENCH, CAPTURES, simulate_benchmark
from handbench.bench.scenes.build import load_scene
from handbench.bench.scenes.echoes import explained
from handbench.bench.scenes.photographs import photo_effects
from handbench.bench.validation.checks import CHANNELS, warnings_of
from handbench.cli.options import set_values
from handbench.radar.simulation.scene import Choice
from handbench.support.config import read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import free_folder
from handbench.support.progress import counted, print_lines, say, warn

# of a row of the table of effects: key → heading
SIZES = {"depth_mm": "depth (mm)", "level_db": "level (dB)", "seconds": "time (s)"}


def simulate(options: argparse.Namespace) -> None:
    """Simulate a scene and write its capture, or all captures of a benchmark.
    With --explain, only print the physical effects: what leaving each out of a coarse simulation
    changes, its time, and why it is on or off."""
    if _is_benchmark(options.scene):
        _simulate_benchmark(options)
        return
    scene = load_scene(options.scene)
    if options.explain:
        photos = scene.file.photos
        _show_effects(explained(scene) + (photo_effects(photos) if photos else ()))
        return
    if not options.out:
        raise HandbenchError(
            "-o: is missing; add -o DIR for the capture folder, or use --explain without it"
        )
    free_folder(options.out, options.overwrite, WRITTEN)
    with counted(1) as progress, progress.part(scene.file.name):
        effects = simulate_capture(scene, options.out, options.frames)
    _show_effects(effects)


def _is_benchmark(path: Path) -> bool:
    """Tell whether a path is a benchmark and not a scene: a file that lists methods, or the name of
    a benchmark that is installed with handbench."""
    if not path.is_file():
        return str(path) in embedded_benchmarks()
    return bool({"method", "base"} & read_toml(path, "a scene or a benchmark").keys())


def _simulate_benchmark(options: argparse.Namespace) -> None:
    if options.explain or options.frames > 1 or not options.out:
        raise HandbenchError(
            "simulate: a benchmark needs -o DIR and accepts neither --explain nor --frames; add "
            "-o DIR and leave these out, or name a scene file"
        )
    for capture in (options.out / CAPTURES).glob("[!.]*"):
        if options.overwrite:
            free_folder(capture, True, WRITTEN)
    count = simulate_benchmark(str(options.scene), options.out, options.overwrite)
    print_lines(
        f"{count} capture{'s' * (count > 1)}: handbench run {options.out / BENCH} -o RESULT"
    )


def _show_effects(rows: tuple[Choice, ...]) -> None:
    """Print physical effects on stdout: those that are on, with the change of depths and echoes and
    the computing time, as far as there are any; and why the others are off."""
    import pandas as pd

    from handbench.reports.tables.rounding import figure
    from handbench.reports.tables.table import Table
    from handbench.reports.tables.writers import terminal

    table = pd.DataFrame([row.model_dump() for row in rows]).set_index("effect")
    sizes = table.loc[table.on, list(SIZES)].dropna(axis=1, how="all")
    terminal(Table("on", sizes.map(figure).rename(columns=SIZES)))
    terminal(Table("off", table.loc[~table.on, ["why"]], left=1))


def import_data(options: argparse.Namespace) -> None:
    """Convert a data set in another format to a capture folder, and write it (-o).
    Prints warnings of what is likely to be wrong with it."""
    settings: dict[str, Any] = {}
    set_values(settings, options.settings, "parameter=S11")
    free_folder(options.out, options.overwrite, IMPORTED)
    import_capture(options.dataset, options.source, options.out, **settings)
    warn(options.out, warnings_of(open_capture(options.out).echoes(), CHANNELS))
    say(f"the capture is in {options.out}")
