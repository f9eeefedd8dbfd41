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

import sys
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
SEED, FIRST_PERSON, HANDS, DRAWS = 7000, 21, 10, 10


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


def maps(folder: Path, person: int) -> Path:
    """The capture of a person's hand in `folder`, and beside it the depth maps METHOD_DRAW.npz of
    its frames."""
    scene = hand(person)
    capture, done = folder / scene.name, folder / f"{scene.name}-maps"
    if not capture.exists():
        simulate_capture(build(scene), capture, DRAWS)
    done.mkdir(exist_ok=True)
    for id in METHODS:
        for draw in range(DRAWS):
            file = done / f"{id}_{draw}.npz"
            if not file.exists():
                echoes = open_capture(capture).echoes(DRAWS)
                settings = configuration(capture, id, {})
                method(id).run(echoes, settings, draw).depth.save(file)
    return capture


def misfit(found: Transform) -> float | None:
    """eᵀC⁻¹e of a transform that should be the identity; None where it states no covariance."""
    if found.covariance is None:
        return None
    error = np.r_[found.matrix[:3, 3], Rotation.from_matrix(found.matrix[:3, :3]).as_rotvec()]
    return float(error @ np.linalg.solve(found.covariance, error))


def main(folder: Path) -> None:
    """Measure, a line per hand and method, and print the share."""
    folder.mkdir(parents=True, exist_ok=True)
    captures = [maps(folder, FIRST_PERSON + n) for n in range(HANDS)]
    for id in METHODS:
        found = []
        for capture in captures:
            files = [folder / f"{capture.name}-maps" / f"{id}_{draw}.npz" for draw in range(DRAWS)]
            found += [misfit(refine_files(file, capture / TRUTH, None)) for file in files]
            print(f"{capture.name} {id}: χ² {found[-DRAWS:]}", flush=True)
        known = np.array([each for each in found if each is not None])
        inside = int((known < chi2.ppf(0.95, 6)).sum())
        print(f"{id}: inside {inside} of {HANDS * DRAWS} (with covariance: {len(known)})")
        print(f"{id}: χ² of 6: mean {known.mean():.2f}, median {np.median(known):.2f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
