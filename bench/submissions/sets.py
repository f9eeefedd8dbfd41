"""Versioned sets of captures, public or hidden, with the benchmark file, the checksums and the metadata to share them.

bench.toml      a benchmark of all captures: `handbench run`, `handbench submit`
captures/NAME   capture folders: echoes, and in the public part or a revealed one the true surface
checksums.txt   of every file, as `sha256sum -c` reads them
croissant.json  what the set holds (MLCommons Croissant 1.0)

In the hidden part other people stand before the radar, drawn by a seed that is told when all have submitted: the
surfaces are made of it again, and `SEED` holds its hash, so that it is the same.
"""

import hashlib
from collections.abc import Iterator
from datetime import date
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomlkit
from pydantic import Field

from bench.datasets.native import DESCRIPTION, ECHOES, TRUTH, CaptureFile, save_capture_file
from bench.datasets.simulated import description
from bench.scenes.build import build
from bench.scenes.echoes import echoes
from bench.scenes.people import MOST_PEOPLE
from bench.scenes.scene_file import HandTarget, SceneFile
from groundtruth.mesh.mesh_files import write_mesh
from radar.data.echoes_file import save_capture
from radar.simulation.causes import Noise
from radar.simulation.scene import Material
from radar.support.config import Config, Name, load, suggest
from radar.support.errors import HandbenchError
from radar.support.files import atomic_folder, inside, read_json, read_text, require_file, write_json, write_text
from radar.support.progress import track
from radar.warmup import compile_kernels

SETS = Path(__file__).parent / "sets"
SCENES = Path(__file__).parents[1] / "run" / "benchmarks"
BENCH, CAPTURES, CHECKSUMS, CROISSANT, SEED = "bench.toml", "captures", "checksums.txt", "croissant.json", "seed.sha256"
Part = Literal["public", "hidden"]
BOXES = ("broadband", "narrowband")  # volumes, of which the z follows the hand
NEAR_M, BEHIND_M = 0.065, 0.015  # of these volumes: before the palm's mid-plane and behind it, as the paper's is


class SetFile(Config):
    """The content of a set's file: every person × scene × distance × material is a capture."""

    version: Literal[1]
    name: Name
    published: date
    scenes: tuple[str, ...] = Field(min_length=1)
    distances_m: tuple[float, ...] = Field(min_length=1)
    materials: tuple[Material, ...] = Field(min_length=1)
    phase_noise_rad: float = Field(ge=0)
    people: int = Field(ge=1, le=1000)
    methods: tuple[str, ...] = Field(min_length=1)


def find_set(name: str) -> tuple[SetFile, Path]:
    """The set of a file, or of the name of an embedded one, and the folder that its scenes' paths start from."""
    path, base = SETS / f"{name}.toml", SCENES
    if name.endswith(".toml"):
        path = require_file(name, "a set of captures")
        base = path.parent
    elif not path.exists():
        known = sorted(file.stem for file in SETS.glob("*.toml"))
        raise HandbenchError(f"set: '{name}' is neither a file nor embedded; {suggest(name, known)}")
    return load(SetFile, path, "a set of captures"), base


def scenes(chosen: SetFile, base: Path, people: dict[str, int]) -> Iterator[tuple[SceneFile, float]]:
    """The scenes of a set, and the distance that each is said to have; people: the number of each name, as p01."""
    for (name, number), file, distance_m, material in product(
        people.items(), chosen.scenes, chosen.distances_m, chosen.materials
    ):
        path = inside(base, file, "scenes")
        scene = load(SceneFile, path, "a scene description").of_person(number)
        if not isinstance(scene.target, HandTarget):
            raise HandbenchError(f"{path}: has no hand; expected one in each scene of a set")
        placed = scene.target.distance_m - HandTarget.model_fields["distance_m"].default + distance_m
        target = scene.target.model_copy(update={"distance_m": placed, "material": material})
        full = f"{scene.target.pose}-{name}-{1e3 * distance_m:.0f}mm-{material.kind}"
        noise = Noise(phase_noise_rad=chosen.phase_noise_rad)
        yield scene.model_copy(update={"name": full, "target": target, "noise": noise, "photos": None}), distance_m


def write_set(
    folder: Path, chosen: SetFile, base: Path, part: Part, seed: int | None, reveal: bool, limit: int | None
) -> list[str]:
    """Simulate the captures that a set's folder does not hold yet, and write its tables; the captures'
    names. base: of the scenes' paths. HandbenchError where the seed is missing, or is another than the folder's."""
    people = _people(folder, chosen, part, seed)
    names: list[str] = []
    compile_kernels(load=False)
    every = list(scenes(chosen, base, people))[:limit]
    for scene, distance_m in track(every, "captures"):
        names.append(scene.name)
        at = folder / CAPTURES / scene.name
        if reveal or not at.is_dir():
            _write_capture(at, scene, base, distance_m, surface=part == "public" or reveal, echoes_there=at.is_dir())
    bench: dict[str, Any] = {"version": 1, "name": f"{chosen.name}-{part}"}
    bench["capture"] = [{"path": f"{CAPTURES}/{name}", "measures": ["accuracy"]} for name in names]
    bench["method"] = [{"id": id} for id in chosen.methods]
    write_text(folder / BENCH, tomlkit.dumps(bench))
    sums = {str(file.relative_to(folder)): _sha256(file) for name in names for file in _files(folder / CAPTURES / name)}
    write_text(folder / CHECKSUMS, "".join(f"{digest}  {name}\n" for name, digest in sums.items()))
    write_json(folder / CROISSANT, croissant(chosen, bench["name"], sums))
    return names


def _people(folder: Path, chosen: SetFile, part: Part, seed: int | None) -> dict[str, int]:
    """The people of a part: 1, 2, … of the public one, and strangers whom the seed draws of the hidden one."""
    if part == "public":
        return {f"p{number:02}": number for number in range(1, chosen.people + 1)}
    if seed is None or seed < 0:
        raise HandbenchError("--seed: is missing or negative; the hidden part is drawn by one that you alone know")
    digest = hashlib.sha256(f"{chosen.name}:{seed}".encode()).hexdigest()
    if (file := folder / SEED).exists() and read_text(file, "the hash of the seed", 1000).strip() != digest:
        raise HandbenchError(f"--seed: is not the one that {folder} was made of; its hash is in {SEED}")
    write_text(file, digest + "\n")
    numbers = np.random.default_rng(seed).choice(np.arange(1000, MOST_PEOPLE), chosen.people, replace=False)
    return {f"h{place:02}": int(number) for place, number in enumerate(numbers, 1)}


def _write_capture(
    at: Path, scene: SceneFile, base: Path, distance_m: float, surface: bool, echoes_there: bool
) -> None:
    """Write a capture folder, or add the surface to one. What it says tells nothing of the hand but letter and
    distance."""
    built = build(scene, base)
    with atomic_folder(at) as temporary:
        if echoes_there:
            (temporary / ECHOES).write_bytes((at / ECHOES).read_bytes())
        else:
            save_capture(temporary / ECHOES, echoes(built).capture)
        if surface:
            write_mesh(temporary / TRUTH, built.target_mesh)
        z_m = {"start_m": round(distance_m - NEAR_M, 6), "stop_m": round(distance_m + BEHIND_M, 6), "step_m": 1e-3}
        about = description(built, sorted(file.name for file in temporary.iterdir()), ())
        told = {key: about[key] for key in ("name", "kind", "pose", "contains")}
        boxes = {method: {"z": z_m} for method in BOXES}
        save_capture_file(temporary, CaptureFile(**told, distance_m=distance_m, methods=boxes))


def _files(capture: Path) -> list[Path]:
    return sorted(file for file in (capture / name for name in (DESCRIPTION, ECHOES, TRUTH)) if file.exists())


def _sha256(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def croissant(chosen: SetFile, name: str, sums: dict[str, str]) -> dict[str, Any]:
    """Metadata of a set's files, by MLCommons' Croissant 1.0: every file with its checksum."""
    kinds = {".h5": "application/x-hdf5", ".ply": "application/x-ply", ".toml": "application/toml"}
    files = [
        {
            "@type": "cr:FileObject",
            "@id": file,
            "name": file,
            "contentUrl": file,
            "encodingFormat": kinds[Path(file).suffix],
            "sha256": digest,
        }
        for file, digest in sums.items()
    ]
    told = {"name": name, "datePublished": chosen.published.isoformat(), "distribution": files}
    return read_json(SETS / CROISSANT, "what is the same of all sets") | told
