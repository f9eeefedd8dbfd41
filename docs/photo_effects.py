"""Measure by whole reconstructions how far each effect of the photographs moves the mesh: the check of the estimates in
docs/measurements/effects.md. `python docs/photo_effects.py WORK [EFFECT …]`; photographs and meshes are kept in WORK."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from bench.datasets.simulated import write_photos
from bench.scenes.build import build
from bench.studies.photogrammetry.cases import REAL, Case
from groundtruth.mesh.mesh_files import raycasting_scene
from groundtruth.mesh.surface import Surface, read_surface
from groundtruth.options import Options
from groundtruth.pipeline import reconstruct
from radar.support.rays import load_open3d

WITHOUT: dict[str, dict[str, Any]] = {
    "noise": {"full_well_e": 1e12, "read_noise_e": 0.0},
    "blur": {"blur_px": 0.0},
    "motion": {"motion_px": 0.0},
    "defocus": {"f_number": None},
    "highlights": {"highlights": 0.0},
    "exposure": {"exposure_spread": 0.0},
    "white_balance": {"white_balance_spread": 0.0},
}
MATCHED_M = 1e-3  # a vertex that is further from the other mesh has no counterpart there


def reconstructed(folder: Path, photos: dict[str, Any], posed: bool) -> Surface:
    """The mesh of hand F's photographs; posed: from the true poses, so that matching alone can move it."""
    file = folder / f"{'posed' if posed else 'mesh'}.ply"
    if not file.exists():
        scene = build(Case("effects", "F", 201, cameras=5, width=1000, photos=photos).scene_file())
        if not (folder / "capture.toml").exists():
            write_photos(scene, folder)
        true = folder / "photos" / "truth_cameras.json" if posed else None
        options = Options(box_m=tuple(scene.box_m.ravel()), cameras=true)
        reconstruct(folder / "photos", options, folder / file.stem).surface.save(file)
    return read_surface(file)


def change(before: Surface, after: Surface) -> tuple[float, float]:
    """Mean distance in mm of the observed vertices to the other mesh, both ways, and the share of them that have no
    counterpart."""
    distances_m = []
    for one, other in ((before, after), (after, before)):
        points = load_open3d().core.Tensor(one.vertices_m[one.observed].astype(np.float32))
        distances_m.append(raycasting_scene(other.mesh).compute_distance(points).numpy())
    distance_m = np.concatenate(distances_m)
    matched = distance_m < MATCHED_M
    return 1e3 * float(distance_m[matched].mean()), 1 - float(matched.mean())


def main(work: Path, effects: list[str]) -> None:
    """Print a table: the change without each effect, from the true poses and from those found."""
    print("| effect | true poses: mm | lost % | whole: mm | lost % |\n|---|--:|--:|--:|--:|")
    for effect in effects:
        cells = []
        for posed in (True, False):
            before = reconstructed(work / "all", REAL, posed)
            moved_mm, lost = change(before, reconstructed(work / effect, REAL | WITHOUT[effect], posed))
            cells += [f"{moved_mm:.4f}", f"{100 * lost:.1f}"]
        print(f"| {effect} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or list(WITHOUT))
