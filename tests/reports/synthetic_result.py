"""A small result folder: a bumpy hand-like surface, four methods with known errors, two
references."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from handbench.bench import results
from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.equal_treatment import EQUAL_METRICS, FIGURES
from handbench.bench.evaluation.floor import budget, floor_mm
from handbench.bench.evaluation.metrics import METRICS, of_captures
from handbench.bench.evaluation.rows import accuracy_rows, precision_rows, time_rows
from handbench.bench.evaluation.tables import CURVES, EQUAL, REPEATS, TASKS, frame
from handbench.bench.evaluation.treatments import SMOOTHING
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.depth import Reference

MESH_SIGMA_M, REGISTRATION_SIGMA_M = 5e-5, 1.5e-4
# name: title, standard deviation and bias of z in mm, share of pixels seen, seconds per frame
METHODS = {
    "2fsk": ("2-FSK", 6.0, 1.0, 0.7, 0.08),
    "3fsk": ("3-FSK", 1.5, 0.2, 0.7, 0.21),
    "broadband": ("Broadband", 0.9, -0.4, 0.9, 42.0),
    "narrowband": ("Narrowband", 12.0, 3.0, 0.6, 1.1),
}


def hand_m(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Depth [ny, nx] of a bumpy ellipse as large as a hand; NaN beside it."""
    x, y = np.meshgrid(x_m, y_m)
    z = 0.29 + 0.006 * np.sin(60 * x) * np.cos(45 * y) + 0.08 * y**2 / 0.1
    return np.where((x / 0.05) ** 2 + (y / 0.09) ** 2 < 1, z, np.nan)


def blurred(noise: np.ndarray) -> np.ndarray:
    """Noise of unit deviation that is correlated over a few pixels, as images are."""
    for axis in (0, 1):
        noise = sum(np.roll(noise, shift, axis) for shift in range(-2, 3))
    return noise / noise.std()


def known(z_m: np.ndarray, reference: str) -> Reference:
    """A reference whose mesh errs by MESH_SIGMA_M and its place along z by REGISTRATION_SIGMA_M;
    the truth does not."""
    mesh_m, along_z_m = (
        (MESH_SIGMA_M, REGISTRATION_SIGMA_M) if reference == "photogrammetry" else (0.0, 0.0)
    )
    registration = Transform("photo", "radar", np.eye(4), np.diag([0, 0, along_z_m**2, 0, 0, 0]))
    leverage = np.where(np.isfinite(z_m)[..., None], [0.0, 0, 1, 0, 0, 0], np.nan)
    return Reference(z_m, np.where(np.isfinite(z_m), mesh_m, np.nan), leverage, registration)


def write_synthetic(
    folder: Path,
    captures: tuple[str, ...] = ("B", "F", "U", "V", "W"),
    methods: dict[str, tuple] = METHODS,
    references: tuple[str, ...] = ("photogrammetry", "truth"),
    step_m: float = 2e-3,
    equal: bool = False,
) -> Path:
    """Write a complete result folder; equal: with the tables of equal treatment."""
    rng = np.random.default_rng(1)
    axis = np.arange(-0.15, 0.15 + step_m / 2, step_m)
    rows, tasks, repeats = [], [], []
    truth = {c: hand_m(axis, axis) + 0.002 * i for i, c in enumerate(captures)}
    surfaces = {"truth": {c: known(z, "truth") for c, z in truth.items()}}
    surfaces["photogrammetry"] = surfaces["completed"] = {
        c: known(z + MESH_SIGMA_M * rng.normal(size=z.shape), "photogrammetry")
        for c, z in truth.items()
    }
    for reference in references:
        for c in captures:
            z, sigma = surfaces[reference][c].z_m, surfaces[reference][c].sigma_m
            results.write_surface(folder, c, reference, results.SurfaceMap(axis, axis, z, sigma))
    for method, (_, deviation_mm, bias_mm, share, seconds) in methods.items():
        maps = {reference: [] for reference in references}
        for c in captures:
            error_mm = bias_mm + deviation_mm * blurred(rng.normal(size=truth[c].shape))
            z = truth[c] + 1e-3 * error_mm
            z[blurred(rng.normal(size=z.shape)) > 2.5 * share - 1] = np.nan
            results.write_surface(folder, c, method, results.SurfaceMap(axis, axis, z))
            cost = (seconds, 2 * seconds, 300.0, False, None, "", None, 0.05, 1e-6)
            tasks.append((f"{c}-{method}", c, method, "image", *cost))
            for reference in references:
                errors = error_map(axis, axis, z, surfaces[reference][c].z_m)
                results.write_errors(folder, c, method, reference, errors)
                maps[reference].append(errors)
        strongest = [0.29 + 6e-4 * deviation_mm * rng.normal(size=10) for _ in range(3)]
        for h, hand in enumerate(strongest):
            repeats += [(f"hand{h}", method, i, z) for i, z in enumerate(hand)]
        for reference in references:
            found = list(surfaces[reference].values())
            floors = [floor_mm(m, r) for m, r in zip(maps[reference], found, strict=True)]
            figures = of_captures(maps[reference]).assign(floor_mm=floors)
            rows.append(accuracy_rows(method, reference, figures))
            rows.append(precision_rows(method, reference, strongest))
            rows.append(time_rows(method, reference, seconds * rng.uniform(0.9, 1.2, 30)))
    photo = (255 * rng.random((400, 500, 3)) * np.linspace(0.2, 1, 500)[:, None]).astype(np.uint8)
    Image.fromarray(photo).save(folder / "photo.png")
    for c in captures:
        results.write_photo(folder, c, folder / "photo.png")
    (folder / "photo.png").unlink()
    tables = {"tasks": frame(TASKS, tasks), "repeats": frame(REPEATS, repeats)}
    tables |= equal_treatment(methods, references[0]) if equal else {}
    results.write_tables(folder, table=pd.concat(rows), **tables)
    results.write_config(folder, 'name = "synthetic"\n')
    budgets = {c: budget(found) for c, found in surfaces["photogrammetry"].items()}
    results.write_about(folder, about(captures, methods, references, budgets))
    return folder


def equal_treatment(methods: dict[str, tuple], reference: str) -> dict[str, pd.DataFrame]:
    """Tables of equal treatment, under each of which a method has its own deviation."""
    figures, curves = [], []
    for treatment in SMOOTHING:
        for method, (_, mm, *_) in methods.items():
            figures += [
                (metric, treatment, method, mm, 0.9 * mm, 1.1 * mm, METRICS[metric].unit, reference)
                for metric in (*FIGURES, *EQUAL_METRICS)
            ]
            curves += [(method, treatment, reference, share, mm) for share in (10.0, 60.0)]
    return {"equal": frame(EQUAL, figures), "curves": frame(CURVES, curves)}


def about(
    captures: tuple[str, ...],
    methods: dict[str, tuple],
    references: tuple[str, ...],
    budgets: dict[str, dict],
) -> results.About:
    """Facts of the synthetic result."""
    scored = [
        results.CaptureFacts(
            name=c, measures=("accuracy",), pose=c, distance_m=0.29, references=references
        )
        for c in captures
    ]
    repeated = [
        results.CaptureFacts(name=f"hand{h}", measures=("precision",), distance_m=0.29)
        for h in range(3)
    ]
    return results.About(
        name="synthetic",
        protocol={
            "poses": list(captures),
            "repeats": 10,
            "threshold_db": {"fsk": -10, "broadband": -13},
        },
        metrics=results.metric_facts(),
        inputs={"bench.toml": "0" * 64},
        versions={"handbench": "0.1.0", "numpy": np.__version__},
        machine={"cpu": "test", "cores": 2, "memory_gb": 8},
        captures=(*scored, *repeated),
        methods=tuple(results.MethodFacts(name=m, title=facts[0]) for m, facts in methods.items()),
        facts={"noise": {"sigma_phi_rad": 0.03}, "groundtruth_sigma_rms": budgets},
    )


def write_synthetic_tradeoff(folder: Path) -> Path:
    """Write a trade-off of two sections: images whose error falls as their time grows, and meshes
    without parts."""
    imaging = [
        setting(
            method,
            tolerance,
            mm * (1 + 30 * tolerance**0.5),
            seconds * tolerance**-0.15,
            front=method == "3fsk",
        )
        for method, mm, seconds in (
            ("2fsk", 6, 0.013),
            ("3fsk", 0.9, 0.012),
            ("broadband", 1.9, 0.1),
        )
        for tolerance in (1e-5, 1e-2)
    ]
    meshes = [
        setting("", views, 0.3 / views**0.5, 3.0 * views, section="groundtruth")
        for views in (4, 8, 16)
    ]
    sections = tuple(
        results.Section(
            name=section,
            title=title,
            metric=metric,
            unit="mm",
            definition="mean of |z − z_ref|",
            reference=reference,
            seconds="from files to the result",
        )
        for section, title, metric, reference in (
            ("imaging", "Imaging", "mae_mm", imaging[0].name),
            ("groundtruth", "Photogrammetry", "rms_mm", meshes[0].name),
        )
    )
    claims = (
        results.Claim(
            text="3-FSK takes a thousandth", paper=1000.0, counted=740.0, measured=31.5, note="both"
        ),
    )
    facts = results.TradeoffFacts(
        name="synthetic",
        scored_against="truth",
        sections=sections,
        claims=claims,
        captures=("B",),
        versions={"numpy": "2"},
    )
    results.write_tradeoff(folder, facts, [*imaging, *meshes])
    return folder


def setting(
    method: str,
    knob: float,
    error_mm: float,
    seconds: float,
    section: str = "imaging",
    front: bool = True,
) -> results.Setting:
    """One line of a trade-off; what has a method tells the parts of its time."""
    title = METHODS[method][0] if method else "photographs"
    return results.Setting(
        section=section,
        name=f"{method or 'views'}-{knob:.3g}",
        title=f"{title}, {knob:.2g}",
        knobs=json.dumps({"method": method, "tolerance": knob} if method else {"views": knob}),
        metric="mae_mm",
        error=error_mm,
        low=0.8 * error_mm,
        high=1.3 * error_mm,
        unit="mm",
        seconds=seconds,
        seconds_low=0.9 * seconds,
        seconds_high=1.2 * seconds,
        ratio=seconds / 0.3,
        acquisition_s=0.003 if method else None,
        plan_s=2.0 if method else None,
        operations=1e9 * seconds if method else None,
        peak_memory_mb=300.0,
        on_front=front,
        dominated_by="" if front else "3fsk-1e-05",
    )
