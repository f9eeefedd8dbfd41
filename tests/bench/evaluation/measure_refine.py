"""The share of hands whose true pose lies in the 95 % ellipsoid that `calibrate --refine` states.

    python -m tests.bench.evaluation.measure_refine DIR

Hands that no other test uses, one person, pose and placement each, are simulated with all that
`auto` switches on and with the table's noise; each frame is one draw of it. The mesh is the true
surface where it truly is, so that all that `refine_files`, which the command calls, moves it is its
error. Of the error e about the surface's middle and the stated covariance C, eᵀC⁻¹e is below the
quantile of χ² in 95 % of all trials if C is right. Frames of one hand share its speckle, hence most
of their error. DIR keeps captures and maps; what it has is not made again.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import TRUTH
from handbench.bench.datasets.simulated import simulate_capture
from handbench.bench.evaluation.refine import refine_files
from handbench.bench.pipeline.image import configuration
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.calibration.transforms import Transform
from handbench.radar.methods.registry import method

POSES = ("B", "F", "U", "A", "L", "V", "Y")
METHODS = ("3fsk", "joint")
TONES_HZ = [82.0e9, 81.8e9, 80.5e9, 79.5e9, 77.0e9, 72.0e9]
PHASE_NOISE_RAD = 0.034  # of the table
SEED, FIRST_PERSON = 7000, 21


def hand(person: int) -> SceneFile:
    """The scene of a person's hand, in the person's place and a pose by turns."""
    pose = POSES[person % len(POSES)]
    scene = {
        "version": 1,
        "name": pose,
        "seed": SEED + person,
        "target": {"kind": "hand", "pose": pose, "material": {"kind": "skin"}},
        "sensor": {"sweep": [], "tones_hz": TONES_HZ},
        "noise": {"phase_noise_rad": PHASE_NOISE_RAD},
    }
    return SceneFile.model_validate(scene).of_person(person)


def maps(folder: Path, person: int, draws: int) -> Path:
    """The capture of a person's hand in `folder` with the depth maps METHOD_DRAW.npz of its
    frames."""
    scene = hand(person)
    capture = folder / scene.name
    if not capture.exists():
        simulate_capture(build(scene), capture, draws)
    done = folder / f"{scene.name}-maps"
    done.mkdir(exist_ok=True)
    wanted = [
        (id, draw)
        for id in METHODS
        for draw in range(draws)
        if not (done / f"{id}_{draw}.npz").exists()
    ]
    if wanted:
        echoes = open_capture(capture).echoes(draws)
        for id, draw in wanted:
            settings = configuration(capture, id, {})
            method(id).run(echoes, settings, draw).depth.save(done / f"{id}_{draw}.npz")
    return capture


def misfit(found: Transform) -> float | None:
    """eᵀC⁻¹e of a transform that should be the identity; None where it states no covariance."""
    if found.covariance is None:
        return None
    error = np.r_[found.matrix[:3, 3], Rotation.from_matrix(found.matrix[:3, :3]).as_rotvec()]
    return float(error @ np.linalg.solve(found.covariance, error))


def main() -> None:
    """Measure, a line per hand and method, and print the share."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=FIRST_PERSON)
    parser.add_argument("--hands", type=int, default=10)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--only-maps", action="store_true")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    captures = [
        maps(options.folder, options.first + n, options.draws) for n in range(options.hands)
    ]
    for id in () if options.only_maps else METHODS:
        told = np.concatenate([misfits(capture, id, options.draws) for capture in captures])
        known = told[np.isfinite(told)]
        inside = int((known < chi2.ppf(0.95, 6)).sum())
        of = f"{len(told)} (without covariance: {len(told) - len(known)})"
        print(
            f"{id}: inside {inside} of {of}; χ² of 6: mean {known.mean():.2f}, median "
            f"{np.median(known):.2f}"
        )


def misfits(capture: Path, id: str, draws: int) -> np.ndarray:
    """The misfit [draws] of each map of a method, NaN where no covariance is stated; prints
    them."""
    found = [refine_files(_map(capture, id, draw), capture / TRUTH, None) for draw in range(draws)]
    told = np.array([misfit(transform) for transform in found], float)
    moved = np.array(
        [np.r_[t.refined["translation_mm"], t.refined["rotation_deg"]] for t in found if t.refined]
    )
    rms = np.sqrt((moved**2).mean(axis=0)).round(2)
    print(
        f"{capture.name} {id}: χ² {told.round(1)}; moved by {rms[:3]} mm and {rms[3:]}° (rms)",
        flush=True,
    )
    return told


def _map(capture: Path, id: str, draw: int) -> Path:
    return capture.with_name(f"{capture.name}-maps") / f"{id}_{draw}.npz"


if __name__ == "__main__":
    main()
