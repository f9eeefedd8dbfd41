"""Submissions to a benchmark: made by a foreign method's command, and checked to be ready for scoring."""

from pathlib import Path

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.run import jobs
from handbench.bench.run.benchmark_file import BenchFile, Source, submitted
from handbench.bench.run.submitted_stage import grid_of
from handbench.bench.submissions import foreign
from handbench.bench.submissions.submission import (
    MAPS,
    Row,
    Submission,
    load_submission,
    problems,
    save_submission,
    sha256,
)
from handbench.radar.data.grid import PixelGrid
from handbench.support.errors import HandbenchError
from handbench.support.files import inside
from handbench.support.progress import say, track


def require_complete(submission: Path, bench: BenchFile, base: Path) -> None:
    """Say every problem of a submission for a benchmark whose paths start from `base`; HandbenchError if there is
    one."""
    grids: dict[str, PixelGrid] = {}
    for source in _scored(bench):
        folder = inside(base, source.path, "capture.path") if source.path is not None else None
        name = jobs.opening(bench, base, source, bench.frames).capture
        grids[name] = grid_of(bench, folder)
    submitted(submission)  # whose name is none of ours
    found = list(problems(submission, grids, bench.name))
    for problem in found:
        say(problem)
    if found:
        raise HandbenchError(f"{submission}: cannot be scored: {len(found)} of its parts are wrong, as said above")


def make(
    folder: Path, about: Submission, bench: BenchFile, base: Path, limit_s: float, limit_bytes: int
) -> dict[str, Row]:
    """Have about.command image every capture of a benchmark into a submission; depth maps of an earlier, ended try
    whose checksums hold are kept. limit_bytes: of addresses, 0: as many as it likes."""
    rows = _kept(folder, about)
    captures = []
    for source in _scored(bench):
        if source.path is None:
            raise HandbenchError(
                f"benchmark '{bench.name}': has a scene, {source.scene}, which nobody has simulated; make its captures "
                "with `handbench hands` or `handbench simulate`, and list their paths"
            )
        captures.append(open_capture(inside(base, source.path, "capture.path")))
    save_submission(folder, about, rows)
    for capture in track(captures, "captures"):
        name, file = capture.about.name, folder / MAPS / f"{capture.about.name}.npz"
        if name in rows and file.is_file() and sha256(file) == rows[name].sha256:
            continue
        grid = grid_of(bench, capture.folder)
        depth, seconds = foreign.image(about.command or "", capture, grid, about, limit_s, limit_bytes)
        depth.save(file)
        rows[name] = Row(name, f"{MAPS}/{file.name}", sha256(file), seconds)
        save_submission(folder, about, rows)
    return rows


def _kept(folder: Path, about: Submission) -> dict[str, Row]:
    """The rows of an earlier try, by the same command."""
    if not folder.exists():
        return {}
    before, rows = load_submission(folder)
    told = "method", "benchmark", "command", "timing"
    same = all(getattr(before, name) == getattr(about, name) for name in told)
    if not same or before.machine.get("processor") != about.machine.get("processor"):
        raise HandbenchError(
            f"{folder}: holds a submission of another command, timing or machine; choose another -o, or --overwrite"
        )
    if rows:
        say(f"{folder}: {len(rows)} depth maps are kept; if the program or the captures have changed, --overwrite")
    return rows


def _scored(bench: BenchFile) -> list[Source]:
    return [source for source in bench.capture if "accuracy" in source.measures]
