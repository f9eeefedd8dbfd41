"""The command line: handbench COMMAND. Nothing heavy is imported before a command is chosen."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from bench.cli import calibrate as calibrate_command
from bench.cli import compare as compare_command
from bench.cli import draw as drawing_command
from bench.cli import groundtruth
from bench.cli import stability as stability_command
from bench.cli import study as study_command
from bench.cli import tradeoff as tradeoff_command
from radar.support.errors import HandbenchError


def main(arguments: list[str] | None = None) -> int:
    """Run one command; a known error is one line on stderr and exit code 2, an unknown one keeps its traceback."""
    options = parser().parse_args(arguments)
    try:
        with _device(options):
            _command(options.command)(options)
    except HandbenchError as error:
        print(f"handbench: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("handbench: interrupted; nothing was left half-written, and `run` resumes", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader went away; so do we
        return 141
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES):
            raise
        where = error.filename or os.environ.get("TMPDIR", "/tmp")
        print(f"handbench: {where}: {error.strerror}; free the space or choose another place", file=sys.stderr)
        return 2
    return 0


def _device(options: argparse.Namespace) -> AbstractContextManager[None]:
    """The device that the command images on, if it images."""
    if "device" not in options:
        return nullcontext()
    from radar.imaging.device import use_device

    return use_device(options.device)


def _command(name: str) -> Callable[[argparse.Namespace], None]:
    from bench.cli import commands

    modules = {
        "calibrate": calibrate_command,
        "draw": drawing_command,
        "groundtruth": groundtruth,
        "stability": stability_command,
        "study": study_command,
    }
    if name in modules:
        return modules[name].run
    reporting = {"run": _run, "report": _report, "compare": _compare, "tradeoff": _tradeoff}
    return reporting.get(name) or getattr(commands, name)


def _run(options: argparse.Namespace) -> None:
    """The main job; ends with the table."""
    from bench.run.benchmark_file import load_benchmark
    from bench.run.runner import run
    from reports.tables.result_tables import show

    bench, base = load_benchmark(options.bench)
    command = f"handbench run {options.bench} -o DIR"
    show(run(bench, base, options.out, options.overwrite, options.scheduler, command))
    print(f"results: {options.out}")


def _report(options: argparse.Namespace) -> None:
    """Result folder → report."""
    from reports.page.html import build

    if options.out.exists() and any(options.out.iterdir()) and not (options.out / "index.html").exists():
        raise HandbenchError(f"{options.out}: holds files but no index.html, so it is no report; choose another -o")
    print(f"report: {build(options.results, options.out, options.tradeoff)}")


def _tradeoff(options: argparse.Namespace) -> None:
    """What accuracy costs in time; ends with the fronts, their report, and the answer to what was asked."""
    from reports.page.tradeoff_section import build

    answer = tradeoff_command.run(options)
    print(f"report: {build(options.out, options.out / 'report')}")
    answer()


def _compare(options: argparse.Namespace) -> None:
    """Two result folders → their differences."""
    from reports.tables.comparison import show, write

    compared = compare_command.run(options)
    if options.out is not None:
        write(compared, options.out)
    show(compared)


def parser() -> argparse.ArgumentParser:
    """All commands and their options."""
    purpose = "How well near-field radar sees a human hand, and what that accuracy costs in time."
    top = argparse.ArgumentParser(prog="handbench", description=purpose)
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    run = _add(commands, "run", "every capture × method of a benchmark → result folder; resumes")
    run.add_argument("bench", metavar="BENCH.toml", help="benchmark file, or the name of an embedded one: paper_table")
    run.add_argument("-o", "--out", required=True, type=Path, metavar="DIR", help="result folder")
    run.add_argument("--overwrite", action="store_true", help="replace the results of another configuration in DIR")
    run.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="let this Dask scheduler's workers do the stages (extra: cluster)",
    )
    _add_device(run)

    simulate = _add(commands, "simulate", "scene file → capture folder (echoes, photographs, true surface)")
    simulate.add_argument("scene", type=Path, metavar="SCENE.toml")
    _out(simulate, "DIR", "capture folder", required=False)
    simulate.add_argument("--explain", action="store_true", help="print which effects the scene calls for, and stop")
    simulate.add_argument("--frames", type=_positive, default=1, help="frames that differ in their noise (default 1)")

    truth = _add(commands, "groundtruth", "photographs, or a mesh in another unit → metric mesh")
    groundtruth.add_arguments(truth)
    _out(truth, "MESH.ply", "mesh, metres")

    calibrate = _add(commands, "calibrate", "target capture → radar_from_photo, covariance, residuals")
    calibrate_command.add_arguments(calibrate)
    _out(calibrate, "TRANSFORM.json", "transform")

    reconstruct = _add(commands, "reconstruct", "one capture, one method → depth map")
    reconstruct.add_argument("capture", type=Path, metavar="CAPTURE")
    reconstruct.add_argument("--method", required=True, metavar="ID", help="see `handbench list`")
    _out(reconstruct, "DEPTH.npz", "depth map")
    reconstruct.add_argument("--frame", type=int, default=0)
    accuracy = reconstruct.add_mutually_exclusive_group()
    accuracy.add_argument("--tolerance", type=float, metavar="1e-3", help="largest relative error of the images")
    accuracy.add_argument("--exact", action="store_true", help="sum every tone of every antenna pair")
    reconstruct.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="settings",
        help="one of the method's parameters, as z.step_m=0.002 (repeatable)",
    )
    reconstruct.add_argument("--volume", type=Path, metavar="V.npz", help="write the complex volume too")
    _add_device(reconstruct)
    reconstruct.add_argument(
        "--check", type=int, default=0, metavar="N", help="compare the volume at N random voxels with the exact sum"
    )

    evaluate = _add(commands, "evaluate", "depth map against a mesh → metrics as JSON on stdout")
    evaluate.add_argument("depth", type=Path, metavar="DEPTH.npz")
    evaluate.add_argument("--mesh", required=True, type=Path, metavar="MESH.ply", help="metres")
    evaluate.add_argument("--transform", type=Path, metavar="T.json", help="carries the mesh into the radar frame")

    draw = _add(commands, "draw", "calibration target or board → drawing at true scale, to print")
    drawing_command.add_arguments(draw)
    _out(draw, "FILE", ".pdf or .svg; .toml: the description itself")

    report = _add(commands, "report", "result folder → tables, figures, HTML")
    report.add_argument("results", type=Path, metavar="DIR")
    report.add_argument("-o", "--out", required=True, type=Path, metavar="REPORT", help="report folder, renewed")
    report.add_argument("--tradeoff", type=Path, metavar="DIR2", help="show this trade-off too (default: DIR/tradeoff)")

    tradeoff = _add(commands, "tradeoff", "what accuracy costs in time: every stage's settings, and their front")
    tradeoff_command.add_arguments(tradeoff)
    _add_device(tradeoff)

    compare = _add(commands, "compare", "two result folders → what differs, tested")
    compare_command.add_arguments(compare)

    stability = _add(commands, "stability", "hard cases: what could blow up, its bound, and the measured figure")
    stability_command.add_arguments(stability)
    _out(stability, "DIR", "folder for stability.csv and .json, as a result folder", required=False)

    study = _add(
        commands, "study", "one of the studies behind the documentation's figures: cases → tables and a figure"
    )
    study_command.add_arguments(study)

    importer = _add(commands, "import", "another data set → capture folder")
    importer.set_defaults(command="import_dataset")
    importer.add_argument("dataset", choices=("maroon", "mapping", "planar_scan"))
    importer.add_argument("source", type=Path, metavar="SRC", help="maroon: OBJECT/DISTANCE; mapping: a folder")
    _out(importer, "DIR", "capture folder")

    exporter = _add(commands, "export", "captures → another data set's layout")
    exporter.set_defaults(command="export_dataset")
    exporter.add_argument("dataset", choices=("maroon",))
    exporter.add_argument("captures", nargs="+", type=Path, metavar="CAPTURE")
    _out(exporter, "ROOT", "the data set's root; ROOT/NAME/CENTIMETRES is written")

    _add(commands, "list", "methods, metrics, benchmarks and poses that there are").set_defaults(command="list_all")
    validate = _add(commands, "validate", "check benchmarks, scenes and captures before hours are spent")
    validate.add_argument("inputs", nargs="+", metavar="INPUT", help="benchmark or scene file, or capture folder")
    _add(commands, "doctor", "what this machine has, and what each missing piece costs")
    return top


def _add(commands: argparse._SubParsersAction, name: str, text: str) -> argparse.ArgumentParser:
    return commands.add_parser(name, help=text, description=text)


def _out(command: argparse.ArgumentParser, metavar: str, text: str, required: bool = True) -> None:
    command.add_argument("-o", "--out", required=required, type=Path, metavar=metavar, help=text)
    command.add_argument("--overwrite", action="store_true", help=f"replace {metavar} if it exists")


def _add_device(command: argparse.ArgumentParser) -> None:
    command.add_argument("--device", choices=("cpu", "cuda"), help="image on (default: HANDBENCH_DEVICE, or cpu)")


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number ≥ 1")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
