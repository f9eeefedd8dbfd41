"""Share of mistakes that `handbench inspect` tells with the right cure, over random scenes, and of
right data that it doubts. The mistakes are written into files, and the typed command reads these.

    python -m tests.bench.validation.measure_mistakes [--scenes 20] [--right 200] -o FOLDER

A cure is right if it undoes the mistake: of a frame, if the surface with the mistake and the cure
lies on the true one. Where the surface with the mistake lies there already, as that of a mirrored
ball does, there is nothing that data could show; this is decided beforehand, by the true surface
alone, and counted apart.
"""

import argparse
import contextlib
import io
import json
import re
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np

from handbench.bench.scenes.echoes import echo_scene
from handbench.cli.main import main
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.bench.studies.ablation import assorted_scenes
from tests.bench.validation.photo_mistakes import PHOTO_MISTAKES, photographs

TONES = {"sweep": [{"start_hz": 72e9, "stop_hz": 82e9, "count": 16}], "tones_hz": [81.8e9, 79.5e9]}
SLOW = {
    "shadow_antennas",
    "shadow_diffraction",
    "multipath",
    "roughness",
    "clutter",
}  # in all, hours of simulation
RIGHT = 1000  # seed of the first capture without a mistake
REACH_M = 0.825  # of 2-FSK at 200 MHz, c/(4Δf) = 0.375 m, which begins at 0.45 m
ALIKE_M = (
    3e-3  # a surface's median distance to its moved self under which nothing tells the two apart
)
FINE = "nothing looks wrong"
UNSCORED = "nothing to score against"

X, Y, Z = (np.diag([-1.0 if axis == k else 1.0 for k in range(3)]) for axis in range(3))
XY, NOTHING = np.eye(3)[[1, 0, 2]], np.eye(3)
FRAMES = {  # a cure's words → what it does to the surface
    "mirrored in x": X,
    "mirrored in y": Y,
    "mirrored in z": Z,
    "turned upside down": X @ Y,
    "with x and y exchanged": XY,
    "in inches": 0.0254 * NOTHING,
    "in millimetres": 1e-3 * NOTHING,
    "in centimetres": 1e-2 * NOTHING,
    "ten times too large": 0.1 * NOTHING,
    "ten times too small": 10 * NOTHING,
    # the array's rx_m is its tx_m with x and y exchanged, to half a step
    "tx and rx exchanged": XY,
}


@dataclass(frozen=True)
class Mistake:
    """A mistake: what it does to a capture, or to the surface; cure: words that must be said.
    Without a cure it is one of frames, that `moved` undoes where it undoes anything. unit: what the
    frequencies in the file are multiplied by; path: which the phases were made with, over the way
    there and back."""

    echoes: Callable[[RadarCapture], RadarCapture] | None = None
    surface: np.ndarray | None = None
    cure: str = ""
    moved: np.ndarray | None = None
    unit: float = 1.0
    path: float = 1.0


def placed(change: np.ndarray) -> Callable[[RadarCapture], RadarCapture]:
    """Antennas elsewhere."""
    return lambda c: replace(
        c, aperture=AntennaArray(c.aperture.tx_m @ change.T, c.aperture.rx_m @ change.T)
    )


def twice(capture: RadarCapture) -> RadarCapture:
    """Tones 3 and on once more in the place of the last."""
    frequencies_hz, samples = capture.frequencies_hz.copy(), capture.samples.copy()
    frequencies_hz[-4:], samples[:, -4:] = frequencies_hz[3:7], samples[:, 3:7]
    return replace(capture, frequencies_hz=frequencies_hz, samples=samples)


MISTAKES = {
    "conjugated": Mistake(
        lambda c: replace(c, samples=c.samples.conj()), cure="conjugate the samples"
    ),
    "tx and rx exchanged": Mistake(
        lambda c: replace(c, aperture=AntennaArray(c.aperture.rx_m, c.aperture.tx_m)),
        cure="exchange tx_m and rx_m",
    ),
    "tones in reverse order": Mistake(
        lambda c: replace(c, frequencies_hz=c.frequencies_hz[::-1].copy()),
        cure="reverse frequencies_hz",
    ),
    "tones duplicated": Mistake(twice, cure="4 of 18 tones are there twice: leave them out"),
    "x negated": Mistake(placed(X), moved=X),
    "y negated": Mistake(placed(Y), moved=Y),
    "x and y exchanged": Mistake(placed(XY), moved=XY),
    "y and z exchanged": Mistake(
        placed(np.eye(3)[[0, 2, 1]]), cure="looks along y: z is to point away from it"
    ),
    "positions in mm": Mistake(placed(1e3 * NOTHING), cure=r"millimetres\? multiply them by 1e-3"),
    "positions in cm": Mistake(placed(1e2 * NOTHING), cure=r"centimetres\? multiply them by 1e-2"),
    "positions in km": Mistake(placed(1e-3 * NOTHING), cure=r"kilometres\? multiply them by 1e3"),
    "frequencies in GHz": Mistake(unit=1e-9, cure=r"gigahertz\? multiply them by 1e9"),
    "frequencies in MHz": Mistake(unit=1e-6, cure=r"megahertz\? multiply them by 1e6"),
    "frequencies in kHz": Mistake(unit=1e-3, cure=r"kilohertz\? multiply them by 1e3"),
    "frequencies × 1000": Mistake(unit=1e3, cure="multiply them,? as by 1e-3"),
    "path one way only": Mistake(path=0.5, cure="counted one way only.*it is there and back"),
    "path twice there and back": Mistake(
        path=2.0, cure="there and back twice.*it is there and back, once"
    ),
    "mesh upside down": Mistake(surface=X @ Y, moved=X @ Y),
    "mesh mirrored in x": Mistake(surface=X, moved=X),
    "mesh z negated": Mistake(surface=Z, moved=Z),
    "mesh in mm": Mistake(surface=1e3 * NOTHING, moved=1e3 * NOTHING),
    "mesh in cm": Mistake(surface=1e2 * NOTHING, moved=1e2 * NOTHING),
    "mesh in inches": Mistake(surface=NOTHING / 0.0254, moved=NOTHING / 0.0254),
    "mesh ten times too large": Mistake(surface=10 * NOTHING, moved=10 * NOTHING),
    "mesh ten times too small": Mistake(surface=NOTHING / 10, moved=NOTHING / 10),
}


def recorded(seed: int, folder: Path, path: float = 1.0) -> tuple[RadarCapture, Surface]:
    """The echoes of the scene of a seed, with its sensor's faults and noise, and its true surface.
    path: what a wave's way is multiplied by: its phases are those of tones that many times
    higher."""
    (sweep,), tones_hz = TONES["sweep"], TONES["tones_hz"]
    sweep = {key: value if key == "count" else value * path for key, value in sweep.items()}
    assorted_scenes.TONES = {"sweep": [sweep], "tones_hz": [value * path for value in tones_hz]}
    scene = assorted_scenes.assorted_scene(seed, folder)
    radar_scene = echo_scene(scene)
    there = tuple(e.id for e in EFFECTS if e.id not in SLOW and not e.missing(radar_scene))
    capture = simulate_scene(radar_scene, choose(radar_scene, there, tolerance_mm=0.0)).capture
    capture = replace(capture, frequencies_hz=capture.frequencies_hz / path)
    write_mesh(folder / "whole.ply", scene.target_mesh)
    return capture, read_surface(folder / "whole.ply")


def moved(surface: Surface, matrix: np.ndarray) -> Surface:
    """The surface elsewhere, its normals outside."""
    faces = surface.faces if np.linalg.det(matrix) > 0 else surface.faces[:, ::-1]
    return replace(surface, vertices_m=surface.vertices_m @ matrix.T, faces=faces)


def written(folder: Path, capture: RadarCapture, surface: Surface, unit: float = 1.0) -> Path:
    """A capture's folder; unit: what the frequencies are multiplied by."""
    folder.mkdir(parents=True)
    save_capture(folder / "echoes.h5", capture)
    with h5py.File(folder / "echoes.h5", "r+") as file:
        file["frequencies_hz"][...] *= unit
    (folder / "capture.toml").write_text('version = 1\nname = "scene"\nkind = "other"\n')
    write_mesh(folder / "truth.ply", mesh(surface.vertices_m, surface.faces))
    return folder


def lies_on(surface: Surface, other: Surface) -> bool:
    """True if what an array sees of a surface, and could shine there, lies on another: nothing then
    tells them apart. Of the surface counts what turns to the array (within 20°), since the rest of
    it is dark."""
    (left, low, _), (right, high, _) = (
        surface.vertices_m.min(axis=0),
        surface.vertices_m.max(axis=0),
    )
    x_m, y_m = np.linspace(left, right, 150), np.linspace(low, high, 150)
    z_m, z_other_m = (depth_on_grid(each.mesh, x_m, y_m) for each in (surface, other))
    slope_y, slope_x = np.gradient(z_m, y_m, x_m)
    x, y = np.meshgrid(x_m, y_m)
    away = np.hypot(
        slope_x + x / z_m, slope_y + y / z_m
    )  # tangent between normal and line of sight
    bright = away < np.tan(np.radians(20))
    off_m = np.where(np.isnan(z_other_m), np.inf, np.abs(z_m - z_other_m))[bright]
    return bool(off_m.size and np.median(off_m) < ALIKE_M)


def hidden(name: str, surface: Surface) -> bool:
    """True if a mistake of frames leaves the surface where it is."""
    matrix = FRAMES["tx and rx exchanged"] if name.startswith("tx") else MISTAKES[name].moved
    isometric = matrix is not None and np.allclose(np.abs(np.linalg.det(matrix)), 1)
    return isometric and lies_on(surface, moved(surface, matrix))


def inspected(path: Path, *words: str) -> str:
    """Everything that `handbench inspect` says."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        main(["inspect", str(path), *words])
    return said.getvalue().replace(str(path), "PATH")


def verdict(mistake: Mistake, said: str, surface: Surface) -> str:
    """told: with the right cure; otherwise: something else; silent: nothing."""
    if mistake.cure and re.search(mistake.cure, said):
        return "told"
    if mistake.moved is not None:
        named = [name for name in FRAMES if re.search(rf"(may be|with) {name}\b", said)]
        if any(lies_on(surface, moved(surface, FRAMES[name] @ mistake.moved)) for name in named):
            return "told"
    return "silent" if FINE in said else "otherwise"


def measure(seeds: range, chosen: list[str], log: Callable[[str], None]) -> dict[str, Counter[str]]:
    """Verdicts by mistake, over the scenes of some seeds."""
    found: dict[str, Counter[str]] = {name: Counter() for name in chosen}
    for seed in seeds:
        with tempfile.TemporaryDirectory() as scratch:
            capture, surface = recorded(seed, Path(scratch))
            for name in chosen:
                mistake, start = MISTAKES[name], time.process_time()
                if hidden(name, surface):
                    found[name]["hidden"] += 1
                    log(f"{seed} | {name} | hidden")
                    continue
                wrong = mistake.echoes(capture) if mistake.echoes else capture
                other = surface if mistake.surface is None else moved(surface, mistake.surface)
                if mistake.path != 1:
                    wrong, _ = recorded(seed, Path(scratch), mistake.path)
                said = inspected(written(Path(scratch) / name, wrong, other, mistake.unit))
                found[name][outcome := verdict(mistake, said, surface)] += 1
                spent_s = time.process_time() - start
                log(
                    f"{seed} | {name} | {outcome} | {spent_s:.1f} s | "
                    f"{' / '.join(said.splitlines())}"
                )
    return found


def measure_photographs(number: int, log: Callable[[str], None]) -> dict[str, Counter[str]]:
    """Verdicts by mistake, over random photographs of random boards."""
    found: dict[str, Counter[str]] = {name: Counter() for name in PHOTO_MISTAKES}
    for seed in range(number):
        for name, cure in PHOTO_MISTAKES.items():
            with tempfile.TemporaryDirectory() as scratch:
                said = inspected(photographs(Path(scratch), seed, name))
                silent = said.strip().endswith(FINE)
                told = re.search(cure, said) is not None if cure else silent
                outcome = "told" if told else "silent" if silent else "otherwise"
                found[name][outcome] += 1
                log(f"{seed} | {name} | {outcome} | {' / '.join(said.splitlines())}")
    return found


def accused(seeds: range, log: Callable[[str], None]) -> tuple[int, int]:
    """Right captures, of other seeds than the mistakes', of which anything is doubted; and of these
    those where the doubt is right: the target stands where the method, with its defaults, does not
    look."""
    doubted, reached = 0, 0
    for seed in seeds:
        with tempfile.TemporaryDirectory() as scratch:
            capture, surface = recorded(seed, Path(scratch))
            start = time.process_time()
            folder = written(Path(scratch) / "right", capture, surface)
            said = inspected(folder)
            (folder / "truth.ply").unlink()  # what then is left to tell by is focus
            said += inspected(folder)
            doubted += any(
                "warning: " in line and UNSCORED not in line for line in said.splitlines()
            )
            reached += (
                "misses a surface" in said and float(np.median(surface.vertices_m[:, 2])) > REACH_M
            )
            kind = assorted_scenes.KINDS[seed % len(assorted_scenes.KINDS)]
            log(
                f"{seed} {kind} | right | {time.process_time() - start:.1f} s | "
                f"{' / '.join(said.splitlines())}"
            )
    return doubted, reached


def table(found: dict[str, Counter[str]]) -> str:
    """The verdicts as Markdown."""
    lines = [
        "| mistake | told with the right cure | otherwise | silent | of | cannot be told |",
        "|---|---|---|---|---|---|",
    ]
    for name, of in found.items():
        able = of.total() - of["hidden"]
        share = f"{of['told']} ({100 * of['told'] / able:.0f} %)" if able else "–"
        lines.append(
            f"| {name} | {share} | {of['otherwise']} | {of['silent']} | {able} | {of['hidden']} |"
        )
    return "\n".join(lines)


def run() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--right", type=int, default=200)
    parser.add_argument("--photographs", type=int, default=20)
    parser.add_argument("--mistakes", nargs="*", default=list(MISTAKES), choices=list(MISTAKES))
    parser.add_argument("-o", "--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with (options.out / "said.log").open("w") as stream:

        def log(line: str) -> None:
            print(line, file=stream, flush=True)

        found = measure(range(options.first, options.first + options.scenes), options.mistakes, log)
        found |= measure_photographs(options.photographs, log)
        doubted, beyond = accused(
            range(RIGHT + options.first, RIGHT + options.first + options.right), log
        )
    text = f"{table(found)}\n\nRight captures that are doubted: {doubted} of {options.right}"
    text += f", of which {beyond} stand further than the method, as it is, can reach.\n"
    (options.out / "table.md").write_text(text)
    facts = {"mistakes": found, "right": options.right, "doubted": doubted, "beyond": beyond}
    (options.out / "counts.json").write_text(json.dumps(facts, indent=2))
    print(text)


if __name__ == "__main__":
    run()
