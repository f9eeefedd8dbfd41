"""The stage that scores a capture: its depth maps against its references; and what it leaves, read when asked for.

errors/       CAPTURE__METHOD__REFERENCE.npz: an `ErrorMap`, as in a result folder
references/   REFERENCE-N.npz: a `Reference`, of its registration the covariance, on the N-th of the methods' grids
grids.json    method → N
frames.json   reference → method → metric → its figure in each frame
alike.json    reference → treatment → method → "figures" and "curve_mm" of `bench.evaluation.equal_treatment`
figures.json  reference → method → metric → its figure, `floor_mm` among them
causes.json   "causes", "reliability" → this capture's lines of these tables
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import NativeCapture
from handbench.bench.evaluation import scoring_protocols
from handbench.bench.evaluation.alike import SMOOTHING, Alike
from handbench.bench.evaluation.equal_treatment import treat
from handbench.bench.evaluation.metrics import Values, figures_of_frame
from handbench.bench.evaluation.scoring_protocols import Protocol
from handbench.bench.pipeline.score import reference_of_file, score, scored_z_m
from handbench.bench.results import errors_path, write_errors
from handbench.bench.results.error_map import ErrorMap
from handbench.bench.run.reconstruct_stage import FRAMES, read_treated
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.data.grid import PixelGrid
from handbench.support.files import read_json, read_npz, write_json, write_npz
from handbench.support.limits import KEPT_BYTES

GRIDS, EACH_FRAME, TREATED, REFERENCES = "grids.json", "frames.json", "alike.json", "references"
FIGURES, CAUSES = "figures.json", "causes.json"
KEPT = ("z_m", "mesh_sigma_m", "met", "leverage", "covariance")
Key = TypeVar("Key")
Value = TypeVar("Value")


class Files(Sequence[Value], Generic[Key, Value]):
    """Objects that lie in files, read each time that it is asked for: of a thousand maps, one is in memory."""

    def __init__(self, read: Callable[[Key], Value], keys: Sequence[Key]) -> None:
        self.read, self.keys = read, keys

    def __len__(self) -> int:
        return len(self.keys)

    def __getitem__(self, index: Any) -> Any:
        return Files(self.read, self.keys[index]) if isinstance(index, slice) else self.read(self.keys[index])


def make(
    folder: Path,
    capture: str,
    maps: Mapping[str, Path],
    references: Mapping[str, tuple[Path, Transform]],
    protocol: str,
) -> None:
    """Compare a capture's depth maps, by method, with its references, each a mesh file and the transform that carries
    it into the radar frame, by a protocol. A reference that cannot be read is a HandbenchError."""
    from handbench.bench.evaluation.error_causes import (  # with pandas: not for `compare`
        Lines,
        Scored,
        lines_of,
        surface_causes,
    )

    chosen = scoring_protocols.protocol(protocol)
    data = open_capture(capture)
    numbers: dict[bytes, int] = {}
    grids: dict[str, int] = {}
    found: list[dict[str, Reference]] = []  # by grid: methods that share one share the references' depths
    sigmas_m: list[dict[str, np.ndarray]] = []  # their standard deviation
    surfaces: list[dict[str, dict[str, np.ndarray]]] = []  # and the causes of errors that they tell
    frames: dict[str, dict[str, list[Values]]] = {name: {} for name in references}
    figures: dict[str, dict[str, Values]] = {name: {} for name in references}
    lines: dict[str, dict[str, Lines]] = {name: {"causes": [], "reliability": []} for name in references}
    for method, file in maps.items():
        depth = load_depthmap(file)
        number = grids[method] = numbers.setdefault(depth.x_m.tobytes() + b"|" + depth.y_m.tobytes(), len(numbers))
        if number == len(found):
            found.append(_on_grid(references, PixelGrid(depth.x_m, depth.y_m)))
            sigmas_m.append({name: reference.sigma_m for name, reference in found[number].items()})
            surfaces.append({n: surface_causes(depth.x_m, depth.y_m, r.z_m) for n, r in found[number].items()})
            for name, reference in found[number].items():
                write_reference(folder, name, number, reference)
        scored_m = list(_frames(depth, file.parent, chosen, data))
        for name, reference in found[number].items():
            scores = score(depth, reference, chosen, data, sigmas_m[number][name])
            write_errors(folder, data.about.name, method, name, scores.errors)
            figures[name][method] = scores.figures
            for table, of in lines_of(Scored(method, name, depth, scores.errors), surfaces[number][name]).items():
                lines[name][table] += of
            frames[name][method] = [figures_of_frame(z_m - reference.z_m) for z_m in scored_m]
    write_json(folder / GRIDS, grids)
    write_json(folder / EACH_FRAME, frames)
    write_json(folder / FIGURES, figures)
    write_json(folder / CAUSES, {t: [x for of in lines.values() for x in of[t]] for t in ("causes", "reliability")})
    alike = {m: treated for m, file in maps.items() if not grids[m] and (treated := read_treated(file.parent))}
    write_json(folder / TREATED, {name: _treated(alike, found[0][name].z_m) for name in references})


def _on_grid(references: Mapping[str, tuple[Path, Transform]], grid: PixelGrid) -> dict[str, Reference]:
    """Every reference's depth on a grid, in their order."""
    found = {
        name: reference_of_file(*files, grid, exact=name == "truth")
        for name, files in references.items()
        if name != "completed"
    }
    if "completed" in references:
        found["completed"] = completed_by(found["photogrammetry"], found["truth"])
    return {name: found[name] for name in references}


def completed_by(reference: Reference, truth: Reference) -> Reference:
    """The reference, where it has no surface by the true one, which has no error."""
    own = np.isfinite(reference.z_m)
    met = truth.met if reference.met is None or truth.met is None else reference.met | truth.met
    return reference._replace(
        z_m=np.where(own, reference.z_m, truth.z_m),
        mesh_sigma_m=np.where(own, reference.mesh_sigma_m, truth.mesh_sigma_m),
        leverage=None if reference.leverage is None else np.where(own[..., None], reference.leverage, 0.0),
        met=met,
    )


def _frames(depth: DepthMap, folder: Path, chosen: Protocol, data: NativeCapture) -> Iterator[np.ndarray]:
    """The depths [ny, nx] of every frame that the protocol scores; `depth` is the first frame's map."""
    yield scored_z_m(depth, chosen, data)
    if (folder / FRAMES).exists():
        for z_m in read_npz(folder / FRAMES, ("z_m",), most=KEPT_BYTES)["z_m"][1:]:
            yield scored_z_m(replace(depth, z_m=z_m), chosen, data)


def _treated(alike: Mapping[str, dict[str, Alike]], reference_z_m: np.ndarray) -> dict[str, dict[str, dict[str, Any]]]:
    """The figures and curves of each treatment and method, ready for JSON."""
    found = {t: treat({m: of[t] for m, of in alike.items()}, reference_z_m) for t in SMOOTHING}
    return {
        treatment: {
            method: {"figures": of.figures, "curve_mm": [v if np.isfinite(v) else None for v in of.curve_mm.tolist()]}
            for method, of in methods.items()
        }
        for treatment, methods in found.items()
    }


def read_errors(folder: Path, capture: str, method: str, reference: str) -> ErrorMap:
    """The errors that `make` found for a depth map."""
    names = ("x_m", "y_m", "error_m", "reference_z_m", "sigma_m", "to_reference_m", "to_map_m")
    return ErrorMap(**read_npz(errors_path(folder, capture, method, reference), names))


def read_reference(folder: Path, method: str, reference: str, transform: Transform) -> Reference:
    """The reference with which `make` compared a method's depth map; transform: the one that carried it there."""
    path = _reference_path(folder, reference, read_json(folder / GRIDS, "a scored capture's grids")[method])
    z_m, mesh_sigma_m, met, leverage, covariance = read_npz(path, KEPT).values()
    registered = (leverage, replace(transform, covariance=covariance)) if covariance.size else (None, None)
    return Reference(z_m, mesh_sigma_m, *registered, met)


def write_reference(folder: Path, name: str, number: int, reference: Reference) -> None:
    """Keep a reference on the number-th grid."""
    known = reference.registration
    uncertain = (np.empty(0), np.empty(0)) if known is None else (reference.leverage, known.covariance)
    values = (reference.z_m, reference.mesh_sigma_m, reference.met, *uncertain)
    write_npz(_reference_path(folder, name, number), **dict(zip(KEPT, values, strict=True)))


def _reference_path(folder: Path, name: str, number: int) -> Path:
    return folder / REFERENCES / f"{name}-{number}.npz"
