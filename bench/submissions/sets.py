"""Versioned sets of captures, with the benchmark file, the checksums and the metadata to share them.

bench.toml      a benchmark of all captures: `handbench run`, `handbench submit`
captures/NAME   capture folders: echoes and the true surface
checksums.txt   of every capture's files, as `sha256sum -c` reads them
croissant.json  what the set holds (MLCommons Croissant 1.0)

A hidden part has people and noise that only the holder of a secret can make again, and no true surfaces until that
holder adds them.
"""

import hashlib
import re
import secrets
import shutil
from collections.abc import Iterator
from datetime import date
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomlkit
from pydantic import Field

from handbench.bench.datasets.native import DESCRIPTION, ECHOES, TRUTH, CaptureFile, save_capture_file
from handbench.bench.datasets.simulated import description
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import echoes
from handbench.bench.scenes.scene_file import HandTarget, SceneFile
from handbench.groundtruth.mesh.mesh_files import write_mesh
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.radar.methods.registry import method
from handbench.radar.simulation.causes import Noise
from handbench.radar.simulation.scene import Material
from handbench.radar.warmup import compile_kernels
from handbench.support.config import Config, Name, load, read_toml, suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import (
    atomic_folder,
    inside,
    read_bytes,
    read_json,
    require_file,
    writable,
    write_json,
    write_text,
)
from handbench.support.progress import track

SETS = Path(__file__).parent / "sets"
SCENES = Path(__file__).parents[1] / "run" / "benchmarks"
BENCH, CAPTURES, CHECKSUMS, CROISSANT = "bench.toml", "captures", "checksums.txt", "croissant.json"
BOXES = ("broadband", "narrowband")  # volumes, of which the z follows the hand
SAME = 0.1  # L2 of echoes of one scene: roundings of two machines make some 0.5 %, another hand more than 100 %
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
    chosen = load(SetFile, path, "a set of captures")
    for id in chosen.methods:
        method(id)  # a typing error is told before hours are spent
    return chosen, base


def read_secret(file: Path, folder: Path, truth: bool) -> str:
    """The secret of a hidden part in `folder`, 32 hexadecimal digits; made where there is no such file, for a new part
    without its true surfaces."""
    if file.resolve().is_relative_to(folder.resolve()):
        raise HandbenchError(f"{file}: lies in {folder}, which is to be handed out; put the secret elsewhere")
    if not truth and not (folder / BENCH).exists() and not file.exists():
        with writable(file, "choose another file for the secret"):
            file.touch(0o600)
            file.write_text(secrets.token_hex(16) + "\n")
    secret = read_bytes(file, "the secret of a hidden part", 64).decode("ascii", "replace").strip()
    if not re.fullmatch("[0-9a-f]{32}", secret):
        raise HandbenchError(f"{file}: holds no 32 hexadecimal digits; a new file's name makes a secret")
    return secret


def _drawn(secret: str, *of: object) -> int:
    """A number of 128 bits, that nobody finds by trying all."""
    return int.from_bytes(hashlib.sha256("/".join(map(str, (secret, *of))).encode()).digest()[:16])


def hidden(chosen: SetFile, secret: str) -> SetFile:
    """The hidden part of a set; its name binds it to the secret, and does not tell it."""
    return chosen.model_copy(update={"name": f"{chosen.name}-hidden-{_drawn(secret, 'name') >> 96:08x}"})


def scenes(chosen: SetFile, base: Path, secret: str = "") -> Iterator[tuple[SceneFile, float]]:
    """The scenes of a set, and the distance that each is said to have; secret: of its hidden part. HandbenchError where
    two have one name."""
    names: set[str] = set()
    for number, file, distance_m, material in product(
        range(1, chosen.people + 1), chosen.scenes, chosen.distances_m, chosen.materials
    ):
        path = inside(base, file, "scenes")
        person = _drawn(secret, "person", number) if secret else number
        scene = load(SceneFile, path, "a scene description").of_person(person)
        if not isinstance(scene.target, HandTarget):
            raise HandbenchError(f"{path}: has no hand; expected one in each scene of a set")
        further_m = distance_m - HandTarget.model_fields["distance_m"].default
        moved = {"distance_m": scene.target.distance_m + further_m, "material": material}
        x_m, y_m, z_m = scene.mount.offset_m  # the stand goes along with the hand
        mount = scene.mount.model_copy(update={"offset_m": (x_m, y_m, z_m + further_m)})
        full = f"{scene.target.pose}-{'h' if secret else 'p'}{number:02}-{1e3 * distance_m:.0f}mm-{material.kind}"
        if full in names:
            raise HandbenchError(f"set '{chosen.name}': two captures are named {full}; make poses, mm and kinds differ")
        names.add(full)
        facts = {"name": full, "target": scene.target.model_copy(update=moved), "mount": mount, "photos": None}
        facts |= {"seed": _drawn(secret, "seed", full)} if secret else {}
        yield scene.model_copy(update=facts | {"noise": Noise(phase_noise_rad=chosen.phase_noise_rad)}), distance_m


def write_set(
    folder: Path, chosen: SetFile, base: Path, limit: int | None, secret: str = "", truth: bool = True
) -> list[str]:
    """Simulate the first `limit` captures that a set's folder does not hold yet, and write the tables of all that it
    holds then; their names. base: of the scenes' paths; secret: of the hidden part, which gets its true surfaces where
    `truth` says so. HandbenchError where the folder holds another set."""
    every = list(scenes(chosen, base, secret))
    content: dict[str, Any] = {"version": 1, "name": chosen.name}
    if (bench := folder / BENCH).exists() or (folder / CAPTURES).exists():
        if not bench.exists() or read_toml(bench, "a benchmark").get("name") != chosen.name:
            raise HandbenchError(f"{folder}: holds another set than {chosen.name}; choose another -o")
    else:
        write_text(bench, tomlkit.dumps(content))  # a set that is interrupted keeps its name
    compile_kernels(load=False)
    checked = False
    for scene, distance_m in track(every[:limit], "captures"):
        at = folder / CAPTURES / scene.name
        if not at.is_dir() or (truth and not (at / TRUTH).exists()):
            built = build(scene, base)
            if at.is_dir() and not checked:
                _require_made_of(at, built)
                checked = True
            _write_capture(at, built, distance_m, bool(secret), truth)
    names = [scene.name for scene, _ in every if (folder / CAPTURES / scene.name).is_dir()]
    content["capture"] = [{"path": f"{CAPTURES}/{name}", "measures": ["accuracy"]} for name in names]
    content["method"] = [{"id": id} for id in chosen.methods]
    write_text(bench, tomlkit.dumps(content))
    files = (folder / CAPTURES / name / part for name in names for part in sorted((DESCRIPTION, ECHOES, TRUTH)))
    sums = {str(file.relative_to(folder)): _sha256(file) for file in files if file.exists()}
    write_text(folder / CHECKSUMS, "".join(f"{digest}  {name}\n" for name, digest in sums.items()))
    write_json(folder / CROISSANT, croissant(chosen, sums))
    return names


def _write_capture(at: Path, built: Scene, distance_m: float, secret: bool, truth: bool) -> None:
    """Write a capture folder, whose volumes lie about the distance; echoes that are there stay. A secret one does not
    tell its seed."""
    with atomic_folder(at) as temporary:
        if at.is_dir():
            shutil.copyfile(at / ECHOES, temporary / ECHOES)
        else:
            save_capture(temporary / ECHOES, echoes(built).capture)
        if truth:
            write_mesh(temporary / TRUTH, built.target_mesh)
        z_m = {"start_m": round(distance_m - NEAR_M, 6), "stop_m": round(distance_m + BEHIND_M, 6), "step_m": 1e-3}
        about = description(built, sorted(file.name for file in temporary.iterdir()), ())
        told = {key: about[key] for key in ("name", "kind", "pose", "contains", *([] if secret else ["seed"]))}
        boxes = {id: {"z": z_m} for id in BOXES}
        save_capture_file(temporary, CaptureFile(**told, distance_m=distance_m, methods=boxes))


def _require_made_of(at: Path, built: Scene) -> None:
    """A HandbenchError unless the echoes of a capture are a scene's, as this version simulates it: a person's or a
    set's other surface would be no truth for them."""
    kept, again = load_capture(at / ECHOES).samples, echoes(built).capture.samples
    off = np.linalg.norm(kept - again) / np.linalg.norm(again) if kept.shape == again.shape else np.inf
    if not off < SAME:
        raise HandbenchError(
            f"{at}: its echoes differ by {100 * off:.0f} % from those that this version makes of the set's file; "
            "expected less than 10 %: add the surfaces with the files and the version that made the echoes"
        )


def _sha256(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def croissant(chosen: SetFile, sums: dict[str, str]) -> dict[str, Any]:
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
    told = {"name": chosen.name, "datePublished": chosen.published.isoformat(), "distribution": files}
    return read_json(SETS / CROISSANT, "what is the same of all sets") | told
