"""Scenes as the simulated factors change them, and their echoes without noise, which are kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import choices, echo_scene
from handbench.bench.scenes.scene_file import CalibrationTarget, MeshTarget, SceneFile
from handbench.groundtruth.mesh.mesh_files import mesh
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.causes import Noise
from handbench.radar.simulation.effects.sensor import PEAK_POINTS, strongest_amplitude
from handbench.radar.simulation.physics.facets import unit
from handbench.radar.simulation.scene import EchoScene, Material
from handbench.radar.simulation.scene_echoes import bare_echoes, generator, require_facets
from handbench.support.code_hash import key_of
from handbench.support.config import load
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, content_hash, read_npz, write_npz
from handbench.support.rays import TriangleMesh
from tests.bench.studies.sensitivity.sensitivity_cases import Value
from tests.bench.studies.sensitivity.sensitivity_factors import SIMULATED

WAVES = 300  # of a smooth random field: with so many it is normal to three standard deviations
PRINTS = ("permittivity", "layer_m")  # factors of printed hands alone
# Effects that each facet has.
ONE_BY_ONE = (
    "obliquity",
    "shadow_centre",
    "shadow_antennas",
    "shadow_diffraction",
    "skin",
    "dielectric",
)
KEPT = ("samples", "frequencies_hz", "tx_m", "rx_m", "points_m", "strongest", "vertices_m", "faces")


@dataclass(frozen=True)
class Clean:
    """Echoes without noise, complex64 [f, t, r], at frequencies_hz before an array; points_m [n, 3]
    of the surface; strongest: the amplitude of their strongest pixel there; surface: the true one,
    radar frame."""

    samples: np.ndarray
    frequencies_hz: np.ndarray
    array: AntennaArray
    points_m: np.ndarray
    strongest: float
    surface: TriangleMesh


@dataclass(frozen=True)
class Hand:
    """The scene of the file at `path` with the tones of `file`, and what it measures; roughness_m:
    the correlation length of its skin."""

    file: SceneFile
    path: Path
    accuracy: bool
    precision: bool
    roughness_m: float

    @property
    def scene(self) -> Scene:
        """The scene as its file has it, without noise and photographs."""
        return replace(
            _built(self.path), file=self.file.model_copy(update={"noise": Noise(), "photos": None})
        )

    @property
    def material(self) -> Material:
        """The material; a target without one is a HandbenchError."""
        if isinstance(self.file.target, CalibrationTarget):
            raise HandbenchError(
                f"scene '{self.file.name}': is a calibration target; the study takes hands"
            )
        return self.file.target.material

    def own(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """The simulated factors that change this hand: place and skin of one that measures the
        accuracy, and a print's own."""
        printed = self.material.kind == "plastic"
        mine = [name for name in SIMULATED if (printed if name in PRINTS else self.accuracy)]
        as_it_is = {"material": self.material.kind, "permittivity": self.material.real_permittivity}
        return {
            name: values[name]
            for name in mine
            if values.get(name, 0) not in (0, as_it_is.get(name, 0))
        }

    def clean(self, values: Mapping[str, Value], work: Path) -> Clean:
        """Its echoes under these values: simulated once, and kept in a folder of `work`. A share of
        diffuse echoes is mixed from those without and those of nothing else."""
        own = self.own(values)
        share = float(own.pop("diffuse", 0.0))
        mirrored = self._kept(own, False, work)
        if share == 0:
            return mirrored
        samples = (1 - share) * mirrored.samples + share * self._kept(own, True, work).samples
        strongest = _strongest(samples, mirrored.frequencies_hz, mirrored.array, mirrored.points_m)
        return replace(mirrored, samples=samples.astype(np.complex64), strongest=strongest)

    def _kept(self, own: dict[str, Value], diffuse: bool, work: Path) -> Clean:
        target = self.file.target
        shape = self.path.parent / target.path if isinstance(target, MeshTarget) else None
        described = (
            self.file.model_dump(mode="json", exclude={"photos", "noise"}),
            shape,
            self.roughness_m,
        )
        key = content_hash(
            *described, own, diffuse, key_of(__name__)
        )  # of modules beside this one, `own` has all
        folder = work / f"echoes-{self.file.name}-{key[:16]}"
        if not folder.is_dir():
            with atomic_folder(folder) as temporary:
                self._make(temporary / "echoes.npz", own, diffuse)
        found = read_npz(folder / "echoes.npz", KEPT)
        samples, frequencies_hz, tx_m, rx_m, points_m, strongest, vertices_m, faces = found.values()
        array = AntennaArray(tx_m, rx_m)
        return Clean(
            samples, frequencies_hz, array, points_m, float(strongest), mesh(vertices_m, faces)
        )

    def _make(self, file: Path, own: dict[str, Value], diffuse: bool) -> None:
        scene = placed(self.scene, own, self.roughness_m)
        radar_scene = echo_scene(scene)
        on = [row.effect for row in choices(scene, radar_scene) if row.on]
        samples, points_m = simulated(radar_scene, on, diffuse)
        f, array = radar_scene.frequencies_hz, radar_scene.array
        strongest = np.float64(_strongest(samples, f, array, points_m))
        body = radar_scene.body
        values = (
            samples,
            f,
            array.tx_m,
            array.rx_m,
            points_m,
            strongest,
            body.vertices_m,
            body.faces,
        )
        write_npz(file, **dict(zip(KEPT, values, strict=True)))


@cache
def _built(path: Path) -> Scene:
    """A scene file's scene, which hands of other tones share."""
    file = load(SceneFile, path, "a scene description")
    return build(file.model_copy(update={"photos": None}), path.parent)


def simulated(scene: EchoScene, on: list[str], diffuse: bool) -> tuple[np.ndarray, np.ndarray]:
    """Samples [f, t, r] of a scene with these effects, and points [n, 3] of its surface, as a run
    has them. diffuse: of a surface that only scatters: the amplitude of each facet has a phase at
    random, the same at all tones, and nothing bounces twice."""
    echoes = bare_echoes(scene)
    for effect in EFFECTS:
        if effect.id in on and (not diffuse or effect.id in ONE_BY_ONE):
            echoes = effect.apply(echoes)
    if diffuse:
        assert echoes.surface is not None  # a hand has one
        facets = require_facets(echoes.surface.facets)
        turns = generator(echoes.seed("diffuse")).random(len(facets))
        facets = replace(facets, area_m2=facets.area_m2 * np.exp(2j * np.pi * turns))
        echoes = replace(echoes, surface=replace(echoes.surface, facets=facets))
    return echoes.samples[0], echoes.points_m[:: max(1, len(echoes.points_m) // PEAK_POINTS)]


def _strongest(
    samples: np.ndarray, frequencies_hz: np.ndarray, array: AntennaArray, points_m: np.ndarray
) -> float:
    top = int(frequencies_hz.argmax())
    return strongest_amplitude(samples[top], frequencies_hz[top], array, points_m)


def placed(scene: Scene, values: Mapping[str, Value], roughness_m: float) -> Scene:
    """The scene with its hand elsewhere, of another material or with another surface: own values,
    but no diffuse."""
    file, number = scene.file, {n: float(v) for n, v in values.items() if not isinstance(v, str)}
    old = file.target
    assert not isinstance(old, CalibrationTarget)  # `Hand.material` refuses it
    material = old.material
    if "material" in values:
        material = Material.model_validate({"kind": values["material"]})
    if "permittivity" in values:
        material = material.model_copy(update={"permittivity": number["permittivity"]})
    target = old.model_copy(
        update={
            "distance_m": old.distance_m + number.get("distance_m", 0.0),
            "offset_m": tuple(np.add(old.offset_m, (0.0, number.get("height_m", 0.0)))),
            "rotation_deg": tuple(
                np.add(
                    old.rotation_deg,
                    (number.get("tilt_x_deg", 0.0), number.get("tilt_y_deg", 0.0), 0.0),
                )
            ),
            "material": material,
        }
    )
    vertices_m, faces = (
        np.asarray(scene.target_mesh.vertices),
        np.asarray(scene.target_mesh.triangles),
    )
    own_m = scene.radar_from_target.inverse().points(vertices_m)
    own_m = own_m + relief_m(own_m, faces, number, roughness_m, file.seed)
    radar_from_target = target.radar_from_target()
    surface = mesh(radar_from_target.points(own_m), faces)
    file = file.model_copy(update={"target": target})
    return replace(scene, file=file, target_mesh=surface, radar_from_target=radar_from_target)


def relief_m(
    vertices_m: np.ndarray,
    faces: np.ndarray,
    values: Mapping[str, float],
    roughness_m: float,
    seed: int,
) -> np.ndarray:
    """The displacement [n, 3] of a hand's vertices [n, 3], in its own frame, by roughness and by a
    print's layers.

    Layers are stacked along y, from the forearm to the fingertips: a surface whose normal has the
    part n_y along it has steps of layer_m·n_y along the normal.
    """
    surface = mesh(vertices_m, faces)
    surface.compute_vertex_normals()
    normals = unit(np.asarray(surface.vertex_normals))
    along_m = np.zeros(len(vertices_m))
    if sigma_m := values.get("roughness_m", 0.0):
        along_m += sigma_m * smooth_field(vertices_m, roughness_m, seed)
    if layer_m := values.get("layer_m", 0.0):
        along_m += layer_m * (0.5 - np.mod(vertices_m[:, 1] / layer_m, 1.0)) * normals[:, 1]
    return along_m[:, None] * normals


def smooth_field(points_m: np.ndarray, length_m: float, *seed: int) -> np.ndarray:
    """A random field [n] at points [n, d]: normal, of mean 0, variance 1 and correlation
    exp(−d²/length²)."""
    random = np.random.default_rng(np.random.SeedSequence(seed))
    waves = random.normal(scale=np.sqrt(2) / length_m, size=(WAVES, points_m.shape[1]))
    phases = random.uniform(0, 2 * np.pi, WAVES)
    total = np.zeros(len(points_m))
    for wave, phase in zip(waves, phases, strict=True):
        total += np.cos(points_m @ wave + phase)
    return np.sqrt(2 / WAVES) * total
