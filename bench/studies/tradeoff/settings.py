"""Every imaging setting as a benchmark file that `handbench run` takes, beside the captures that it was measured on."""

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

import tomlkit

from handbench.bench.datasets.dataset import AT_EMPTY_FILTERED
from handbench.bench.run.benchmark_file import BenchFile, MethodEntry, Source
from handbench.bench.run.outcome import Capture
from handbench.bench.run.sweep import ImagingSetting
from handbench.support.files import write_text

FOLDER, CAPTURES = "settings", "captures"


def setting_path(folder: Path, name: str) -> Path:
    """The place of a setting in a trade-off folder."""
    return folder / FOLDER / f"{name}.toml"


def write_settings(
    folder: Path,
    bench: BenchFile,
    base: Path,
    work: Path,
    captures: Iterable[Capture],
    targets: Iterable[Capture],
    settings: Iterable[ImagingSetting],
) -> None:
    """Write settings/NAME.toml and, in the same folder since a benchmark reads nothing outside of its own, the captures
    and the calibration's targets: the same files under another name (hard links), copies where the file system has
    none."""
    into = folder / FOLDER
    sources = [tuple(_linked(c, into, base.resolve(), work.resolve()) for c in some) for some in (captures, targets)]
    for setting in settings:
        entry = MethodEntry(id=setting.method, config=setting.config, every_nth_antenna=setting.every_nth_antenna)
        alone = bench.model_copy(
            update={
                "name": setting.name,
                "phase_noise_rad": None,
                "capture": sources[0],
                "calibration": sources[1],
                "dataset": None,
                "method": (entry,),
                "tradeoff": None,
            }
        )
        comment = f"# {setting.title}: a setting of a trade-off, with its captures. Run it with `handbench run`.\n"
        text = tomlkit.dumps(alone.model_dump(mode="json", exclude_none=True))
        write_text(setting_path(folder, setting.name), comment + text)


def _linked(capture: Capture, into: Path, base: Path, work: Path) -> Source:
    """The capture's place in the folder: under its own path, which some data sets take names from, if it was recorded;
    under its name, if it was simulated."""
    folder = capture.folder.resolve()
    recorded = folder.is_relative_to(base) and not folder.is_relative_to(work)
    place = folder.relative_to(base) if recorded else Path(CAPTURES) / capture.name
    real = folder.with_name(folder.name.removesuffix(AT_EMPTY_FILTERED))
    target = into / place.with_name(place.name.removesuffix(AT_EMPTY_FILTERED))
    shutil.copytree(real, target, copy_function=_link_or_copy, dirs_exist_ok=True)
    return Source(path=place.as_posix())


def _link_or_copy(source: str, target: str) -> None:
    try:
        os.link(os.path.realpath(source), target)
    except FileExistsError:  # of another setting's
        pass
    except OSError:  # another file system, or one without links
        shutil.copy2(source, target)
