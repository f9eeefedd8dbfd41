"""A small result folder: a bumpy hand-like surface and four methods with known errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.main_table import main_table
from handbench.bench.evaluation.metrics import figures
from handbench.bench.evaluation.scoring_protocols import PAPER
from handbench.bench.evaluation.tables import COMPARISONS, SCORES, TASKS, frame
from handbench.bench.evaluation.treatments import SMOOTHING
from handbench.bench.results.about import About, CaptureFacts, MethodFacts, metric_facts
from handbench.bench.results.maps import (
    SurfaceMap,
    depth_path,
    write_errors,
    write_photo,
    write_surface,
)
from handbench.bench.results.result_folder import Result, write_about, write_tables
from handbench.radar.data.depthmap import DepthMap
from handbench.support.files import write_text

FLOOR_MM = {"photogrammetry": 0.126, "completed": 0.2, "truth": 0.0}
METHODS = {  # name: title, standard deviation of z in mm, seconds per frame
    "2fsk": ("2-FSK", 6.0, 0.08),
    "3fsk": ("3-FSK", 1.5, 0.21),
    "broadband": ("Broadband", 0.9, 42.0),
    "narrowband": ("Narrowband", 12.0, 1.1),
}
ELEVEN = {  # the methods of the embedded table, as METHODS
    "2fsk": ("2-FSK", 7.6, 0.02),
    "3fsk": ("3-FSK", 1.0, 0.04),
    "broadband": ("broadband", 1.1, 1.4),
    "narrowband": ("narrowband", 13.0, 0.3),
    "3fsk-offaxis": ("3-FSK off-axis", 0.9, 0.04),
    "3fsk-weighted": ("3-FSK weighted", 0.8, 0.05),
    "3fsk-plus": ("3-FSK plus", 0.7, 0.05),
    "nfsk-plus": ("ladder plus", 0.6, 0.2),
    "joint": ("joint", 0.6, 5.0),
    "broadband-aligned": ("broadband aligned", 0.5, 12.0),
    "broadband-subvoxel": ("broadband sub-voxel", 1.1, 1.4),
}
RESULTS: dict[str, dict] = {  # arguments of write_synthetic
    "table": {
        "captures": ("B", "F", "U"),
        "methods": ELEVEN,
        "references": ("photogrammetry", "completed", "truth"),
        "equal": True,
        "tested": ("complete_2mm_percent",),
    },
    "strangers": {  # names as long, and as strange, as a user may give
        "captures": ("left hand of subject 17, second session, thumb abducted", "Ωß手_%$#&{}^~"),
        "methods": {
            "3fsk-longest": ("3-FSK of 82, 81.8 and 72 GHz, median of 5 pixels & more", 1.5, 0.2),
            "other": ("<b>Wirkungsquerschnittsrückprojektionsverfahren_2</b>", 123.4, 1234.5),
        },
        "paper": False,
    },
    "sphere": {
        "captures": ("sphere",),
        "methods": {"3fsk": ("3-FSK", 0.5, 0.04)},
        "references": ("truth",),
        "paper": False,
    },
    "many": {
        "captures": tuple(f"subject-{n:03d}" for n in range(120)),
        "methods": {name: METHODS[name] for name in ("2fsk", "3fsk")},
        "references": ("photogrammetry",),
        "tested": ("mae_mm", "complete_2mm_percent"),
        "paper": False,
    },
}


def hand_m(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Depth [ny, nx] of a bumpy ellipse as large as a hand; NaN beside it."""
    x, y = np.meshgrid(x_m, y_m)
    z = 0.29 + 0.006 * np.sin(60 * x) * np.cos(45 * y) + 0.08 * y**2 / 0.1
    return np.where((x / 0.05) ** 2 + (y / 0.09) ** 2 < 1, z, np.nan)


def write_synthetic(
    folder: Path,
    captures: tuple[str, ...] = ("B", "F", "U", "V", "W"),
    methods: dict[str, tuple] = METHODS,
    references: tuple[str, ...] = ("photogrammetry", "truth"),
    step_m: float = 2e-3,
    equal: bool = False,
    tested: tuple[str, ...] = (),
    meshes: dict[str, dict[str, float]] | None = None,
    paper: bool = True,
) -> Path:
    """Write a complete result folder; equal: with figures under equal treatment; tested: the
    metrics by which its protocol compares methods; meshes: figures of settings of the ground
    truth; paper: with the paper's figures. The id of a method is its name up to the first dash."""
    rng, axis = np.random.default_rng(1), np.arange(-0.1, 0.1, step_m)
    folder.mkdir(parents=True, exist_ok=True)
    photo = folder / "photo.png"
    Image.fromarray(rng.integers(0, 255, (400, 500, 3), np.uint8)).save(photo)
    lines, z_m = [], hand_m(axis, axis)
    for c in captures:
        write_photo(folder, c, photo)
        for reference in references:
            write_surface(folder, c, reference, SurfaceMap(axis, axis, z_m))
        for method, (_, mm, _) in methods.items():
            error_m = 1e-3 * mm * rng.normal(size=z_m.shape)
            seen = z_m + np.where(rng.random(z_m.shape) < 0.2, np.nan, error_m)
            depth = DepthMap(axis, axis, seen, np.zeros(seen.shape), method)
            depth.save(depth_path(folder, c, method))
            errors = error_map(axis, axis, seen, z_m)
            for reference in references:
                write_errors(folder, c, method, reference, errors)
                values = figures(errors) | {"floor_mm": FLOOR_MM[reference]}
                lines += [(c, method, reference, "", 0, *each) for each in values.items()]
                lines += [(c, method, reference, t, 0, "mae_mm", mm) for t in SMOOTHING if equal]
    photo.unlink()
    for method, (_, mm, seconds) in methods.items():
        of_method = captures[0], method, "", ""
        z_m = 0.29 + 6e-4 * mm * rng.normal(size=10)
        seconds = seconds * rng.uniform(0.9, 1.2, 30)
        lines += [(*of_method, n, "strongest_z_m", z) for n, z in enumerate(z_m)]
        lines += [(*of_method, n, "seconds", s) for n, s in enumerate(seconds)]
    table = main_table(frame(SCORES, lines), PAPER, 0, with_paper=paper)
    for name, found in (meshes or {}).items():
        lines += [(captures[0], name, "truth", "", 0, *each) for each in found.items()]
    cost = (2.0, 2.0, 300.0, False, None, "", None, 0.05)
    tasks = [(f"{c}-{m}", c, m, "image", *cost) for c in captures for m in methods]
    tables = {"tasks": frame(TASKS, tasks), "scores": frame(SCORES, lines)}
    write_tables(folder, table=table, **tables)
    write_text(folder / "config.toml", 'name = "synthetic"\n')
    about = About(
        name="synthetic",
        protocol={"id": "paper", "version": 4, "compared": tested},
        metrics=metric_facts(),
        inputs={"bench.toml": "0" * 64},
        versions={"numpy": np.__version__},
        machine={"cpu": "test"},
        captures=tuple(CaptureFacts(name=c, references=references) for c in captures),
        methods=tuple(
            MethodFacts(name=m, title=of[0], id=m.partition("-")[0]) for m, of in methods.items()
        ),
    )
    write_about(folder, about)
    return folder


def compared(result: Result, lines: pd.DataFrame | list[tuple]) -> Result:
    """The result with these lines as its table of comparisons."""
    found = replace(result)
    found.__dict__["comparisons"] = frame(COMPARISONS, lines) if isinstance(lines, list) else lines
    return found
