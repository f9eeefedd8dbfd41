"""What each command does: open the inputs, call the library, write the output."""

from __future__ import annotations

import argparse
import json
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radar.support.errors import HandbenchError
from radar.support.progress import say

if TYPE_CHECKING:  # --help answers without them
    import numpy as np

    from radar.data.capture import RadarCapture

EXACT = 1e-5  # what the exact sum is good to, in single precision


def simulate(options: argparse.Namespace) -> None:
    """Scene → capture folder; or what its echoes would show, and why."""
    from bench.cli.explain import show
    from bench.datasets.simulated import simulate_capture
    from bench.scenes.build import load_scene
    from bench.scenes.echoes import choices

    if options.explain:
        show(choices(load_scene(options.scene), explain=True))
        return
    if options.out is None:
        raise HandbenchError("-o: is missing; name a capture folder, or ask for --explain alone")
    _free_folder(options.out, options.overwrite, "capture.toml")
    show(simulate_capture(load_scene(options.scene), options.out, options.frames))
    say(f"capture: {options.out}")


def reconstruct(options: argparse.Namespace) -> None:
    """Capture × method → depth map."""
    from bench.datasets.dataset import open_capture
    from bench.run.reconstruct_stage import configuration
    from radar.imaging.device import describe
    from radar.methods.registry import method
    from radar.support.files import write_npz
    from radar.warmup import compile_kernels

    for file in filter(None, (options.out, options.volume)):
        free(file, options.overwrite)
    if options.volume == options.out:
        raise HandbenchError(f"--volume: is the same file as -o, {options.out}; name two")
    chosen = method(options.method)
    defaults = configuration(options.capture, chosen.id, {})
    settings = chosen.configure(_settings(options, defaults.model_dump(mode="json")), "--set or --tolerance")
    echoes = open_capture(options.capture).echoes(max(options.frame, 0) + 1)
    if not 0 <= options.frame < len(echoes.samples):
        raise HandbenchError(f"--frame: is {options.frame}; the capture has frames 0 to {len(echoes.samples) - 1}")
    if (options.volume is not None or options.check) and "z" not in chosen.config.model_fields:
        raise HandbenchError(f"--volume, --check: '{chosen.id}' makes no volume; choose broadband or narrowband")
    compile_kernels()
    result = chosen.run(echoes, settings, options.frame)
    result.depth.save(options.out)
    if options.volume is not None or options.check:
        volume = result.volume()
        if options.volume is not None:
            write_npz(options.volume, volume=volume, z_m=result.volume_z_m)
        if options.check:
            _check(volume, echoes, settings, options)
    on_target = int((result.depth.z_m == result.depth.z_m).sum())
    say(f"{options.out}: {on_target} pixels on target, imaged on {describe()}")


def _check(volume: np.ndarray, echoes: RadarCapture, settings: Any, options: argparse.Namespace) -> None:
    """Say how far the volume is from the exact sum, and refuse one that is further than was asked."""
    from radar.imaging.api import imaging_error

    samples, frequencies_hz = echoes.tones(settings.tones_hz(), options.frame)
    error = imaging_error(volume, samples, frequencies_hz, echoes.aperture, settings.grid(), options.check)
    say(f"checked at {options.check} random voxels against the exact sum: relative error {error:.1e}")
    if error > (settings.tolerance or EXACT):
        raise HandbenchError(
            f"--check: the volume's relative error is {error:.1e}; expected at most {settings.tolerance or EXACT:g}; "
            "please report the capture, and use --exact meanwhile"
        )


def evaluate(options: argparse.Namespace) -> None:
    """Depth map × mesh → metrics on stdout."""
    from bench.evaluation.floor import floor_mm
    from bench.evaluation.metrics import definitions, error_map, pool
    from bench.run.scoring import reference_depth
    from calibration.alignment import load_any_transform
    from calibration.transforms import identity
    from radar.data.depthmap import load_depthmap
    from radar.data.grid import PixelGrid

    depth = load_depthmap(options.depth)
    transform = load_any_transform(options.transform) if options.transform else identity("radar")
    reference = reference_depth(options.mesh, transform, PixelGrid(depth.x_m, depth.y_m))
    errors = error_map(depth.x_m, depth.y_m, depth.z_m, reference.z_m, reference.sigma_m, reference.met)
    values = pool([errors]) | {"floor_mm": floor_mm([errors], [reference])}
    about = {"method": depth.method, "definitions": definitions(list(values))}
    if transform.refined:
        about["refined"] = f"{options.transform}: {transform.refined['reason']}"
    print(json.dumps({**values, **about}, indent=2))


def import_dataset(options: argparse.Namespace) -> None:
    """Foreign data → capture folder."""
    from bench.datasets.dataset import import_capture
    from bench.datasets.planar_scan import import_planar_scan

    _free_folder(options.out, options.overwrite, "capture.toml")
    if options.dataset == "planar_scan":
        import_planar_scan(options.source, options.out)
    else:
        import_capture(options.dataset, options.source, options.out)
    say(f"capture: {options.out}")


def export_dataset(options: argparse.Namespace) -> None:
    """Captures → another data set's layout."""
    from bench.datasets.maroon_export import export_maroon

    for capture in options.captures:
        say(f"capture: {export_maroon(capture, options.out, options.overwrite)}")


def list_all(options: argparse.Namespace) -> None:
    """Everything that has a name."""
    from bench.cli.listing import show

    show()


def validate(options: argparse.Namespace) -> None:
    """Every problem of every input, with its file and line; exit code 2 if there is one."""
    from bench.validation.validate import show

    show(options.inputs)


def doctor(options: argparse.Namespace) -> None:
    """The machine, in plain words."""
    from bench.cli.doctor import show

    show()


def free(path: Path, overwrite: bool) -> None:
    """Refuse to overwrite unless asked to."""
    if path.exists() and not overwrite:
        raise HandbenchError(f"{path}: exists already; choose another -o, or --overwrite to replace it")


def _free_folder(path: Path, overwrite: bool, mark: str) -> None:
    """As `free`, and even then replace only a folder that holds `mark`, which handbench writes."""
    free(path, overwrite)
    if path.exists() and not (path / mark).is_file():
        raise HandbenchError(f"{path}: holds no {mark}, so handbench did not write it; choose another -o")


def numbers(text: str | None, count: int, option: str) -> tuple[float, ...] | None:
    """The numbers of an option's text; None without one."""
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count:
        raise HandbenchError(f"{option}: is '{text}'; expected {count} numbers separated by commas")
    return values


def _settings(options: argparse.Namespace, values: dict[str, Any]) -> dict[str, Any]:
    """`values` with --set, --tolerance and --exact put in; methods that always image exactly have no tolerance."""
    for setting in options.settings:
        key, separator, text = setting.partition("=")
        *parents, leaf = key.split(".")
        place: Any = values
        for parent in parents:
            place = place.setdefault(parent, {}) if isinstance(place, dict) else None
        if not separator or not isinstance(place, dict):
            raise HandbenchError(f"--set: is '{setting}'; expected KEY=VALUE, as z.step_m=0.002")
        try:
            place[leaf] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            place[leaf] = text
    if "tolerance" in values and (options.exact or options.tolerance is not None):
        values["tolerance"] = options.tolerance
    return values
