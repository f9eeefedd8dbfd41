"""`handbench demo`: simulate a hand, image it with the paper's four methods, and show their errors
and one picture."""

import argparse
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from statistics import median

from handbench.support.errors import HandbenchError
from handbench.support.files import write_text
from handbench.support.progress import print_lines, say

METHODS = ("2fsk", "3fsk", "narrowband", "broadband")
HAND = files("handbench.bench.benchmarks") / "demo_hand.toml"
SCENE, CAPTURE, PICTURE = "hand.toml", "capture", "demo.png"
TOLERANCE = 1e-3  # of the images: a hundredth of what the methods' errors are


def demo(options: argparse.Namespace) -> None:
    """Simulate a hand, image it with the paper's four methods, score the depth maps against the
    true surface and draw them, all in one folder (-o).
    Prints errors and seconds per frame. If the folder has an earlier demo of this version, its
    capture is used again."""
    from handbench.bench.run.engine import executor
    from handbench.bench.stages.image import image_point
    from handbench.interface import simulate

    folder = options.out
    _claim(folder)
    if (capture := folder / CAPTURE).exists():  # which appears whole or not at all
        say(f"{capture}: exists already and is used again")
    else:
        with executor(1) as process:  # it has all cores, which it needs longer than this one
            assert process is not None
            simulated = process.submit(simulate, folder / SCENE, capture)
            import handbench.reports.figures.depth_maps  # noqa: F401  which needs no echoes

            for id in METHODS:  # plan the images and compile the kernels
                image_point(id, {"tolerance": TOLERANCE})
            simulated.result()
    _image_and_score(folder)


def _image_and_score(folder: Path) -> None:
    """Image the capture in a folder by all methods, score and draw their depth maps, and print the
    table."""
    from handbench.bench.datasets.native import TRUTH
    from handbench.bench.evaluation.metrics import Values, chosen
    from handbench.bench.stages.reconstruct import Imager
    from handbench.interface import Depth
    from handbench.radar.methods.registry import titles
    from handbench.reports.figures.depth_maps import methods_figure
    from handbench.reports.figures.style import save
    from handbench.reports.tables.table import of_values
    from handbench.reports.tables.writers import notes, terminal
    from handbench.support.cost import machine

    capture, truth = folder / CAPTURE, folder / CAPTURE / TRUTH
    shown = []
    rows: dict[str, Values] = {}
    for id in METHODS:
        images = Imager(capture, id, {"tolerance": TOLERANCE}).images()
        depth, title = images.depths[0], titles()[id]
        depth.save(folder / f"{id}.npz")
        score = Depth(depth).evaluate(truth)
        values = score | {"seconds": median(images.seconds)}
        rows[title] = {key: values[key] for key in chosen("summary") if key in values}
        shown.append((title, depth.z_m, score.errors))
        say(f"{folder / id}.npz: imaged and scored")
    save(methods_figure("true surface", shown), folder / PICTURE)
    terminal(of_values("Scored against the true surface", rows))
    facts = machine()
    notes(f"tolerance {TOLERANCE:g}", f"{facts['cores']} cores of {facts['processor']}")
    print_lines(
        f"picture: {folder / PICTURE}",
        "next:",
        f"  handbench reconstruct {capture} --method joint -o joint.npz",
        f"  handbench evaluate joint.npz --mesh {truth}",
        f"  handbench simulate {folder / SCENE} --explain",
        "  handbench list",
    )


def _claim(folder: Path) -> None:
    """Write the scene file into a new or empty folder, or accept a folder that an earlier demo of
    the same version has made. Raises HandbenchError for any other folder."""
    marked = f"# The scene of `handbench demo`, handbench {version('handbench')}.\n"
    marked += HAND.read_text("utf-8")
    mark = folder / SCENE
    if not any(folder.glob("*")):
        write_text(mark, marked)
    elif not mark.is_file() or mark.read_text("utf-8", "replace") != marked:
        raise HandbenchError(
            f"{folder}: exists, but this version of `handbench demo` did not write it; choose "
            "another folder for -o, or remove this one"
        )
