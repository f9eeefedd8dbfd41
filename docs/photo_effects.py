"""Measure how far effects of photographs, such as blur and noise, move the reconstructed mesh (for
docs/measurements/effects.md): python docs/photo_effects.py WORK [EFFECT …]

Photographs and meshes are kept in the folder WORK and used again.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.simulated import write_photos
from handbench.bench.scenes.build import Scene, build
from handbench.bench.studies.photogrammetry.photogrammetry_cases import PhotogrammetryCase
from handbench.groundtruth.mesh.mesh_files import raycasting_scene
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.groundtruth.options import Options
from handbench.groundtruth.pipeline import reconstruct
from handbench.support.rays import load_open3d

IDEAL: dict[str, Any] = {"full_well_e": 1e12, "read_noise_e": 0.0, "blur_px": 0.0}
ADDED: dict[
    str, dict[str, Any]
] = {  # far above what two reconstructions of the same photographs differ by
    "highlights": {"highlights": 4.0},
    "defocus": {"f_number": 4.0},
    "noise": {"full_well_e": 1500.0, "read_noise_e": 6.0},
    "blur": {"blur_px": 1.5},
    "motion": {"motion_px": 4.0},
    "exposure": {"exposure_spread": 1.0},
    "white_balance": {"white_balance_spread": 0.5},
    "speckle": {"speckle": 0.7},
}
MATCHED_M = 1e-3  # a vertex that is further from the other mesh has no counterpart there


def scene_of(photos: dict[str, Any]) -> Scene:
    """Return the scene of a hand (letter F) in front of five small cameras.
    photos: settings of the photographs, by which an effect is switched on."""
    return build(
        PhotogrammetryCase(
            "effects", "F", 201, cameras=5, width=1000, photos=IDEAL | photos
        ).scene_file()
    )


def reconstructed(folder: Path, photos: dict[str, Any], posed: bool, seed: int = 0) -> Surface:
    """Return the mesh reconstructed from simulated photographs; it is read from `folder` if it was
    made before.
    photos: settings of the photographs; posed: use the true poses of the cameras, so that an effect
    can move the mesh only by dense matching; seed: of the reconstruction."""
    file = folder / f"{'posed' if posed else 'whole'}-{seed}.ply"
    if not file.exists():
        scene = scene_of(photos)
        if not (folder / "capture.toml").exists():
            write_photos(scene, folder)
        true = folder / "photos" / "truth_cameras.json" if posed else None
        options = Options(box_m=tuple(scene.box_m.ravel()), cameras=true, seed=seed)
        reconstruct(folder / "photos", options, folder / file.stem).surface.save(file)
    return read_surface(file)


def change(before: Surface, after: Surface) -> tuple[float, float]:
    """Compare two meshes: return the mean distance, mm, from the observed vertices of each mesh to
    the other mesh, and the share of vertices that are further than 1 mm (MATCHED_M) from it. These
    are not in the mean."""
    distances_m = []
    for one, other in ((before, after), (after, before)):
        points = load_open3d().core.Tensor(one.vertices_m[one.observed].astype(np.float32))
        distances_m.append(raycasting_scene(other.mesh).compute_distance(points).numpy())
    distance_m = np.concatenate(distances_m)
    matched = distance_m < MATCHED_M
    return 1e3 * float(distance_m[matched].mean()), 1 - float(matched.mean())


def main(work: Path, effects: list[str]) -> None:
    """Print a table of how far each effect moves the mesh, with the true camera poses and with
    estimated ones."""
    print("| effect added | true poses: mm | lost % | whole: mm | lost % |")
    print("|---|--:|--:|--:|--:|")
    for effect in ["another seed", *effects]:
        cells = []
        for posed in (True, False):
            ideal = reconstructed(work / "ideal", {}, posed)
            name, added = (effect, ADDED[effect]) if effect in ADDED else ("ideal", {})
            moved_mm, lost = change(
                ideal, reconstructed(work / name, added, posed, effect not in ADDED)
            )
            cells += [f"{moved_mm:.4f}", f"{100 * lost:.1f}"]
        print(f"| {effect} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or list(ADDED))
