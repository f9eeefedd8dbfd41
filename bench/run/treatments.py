"""Depth maps for equal treatment: a method's map again, with every averaging filter as wide as all others'."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench.evaluation.alike import OPEN_DB, SMOOTHING, Alike
from radar.data.depthmap import DepthMap
from radar.methods.smoothing import masked_mean
from radar.support.config import Config
from radar.support.files import read_npz, write_npz

ALIKE = "alike.npz"
FILTERS, DROPS = "_filter_px", "drop_"  # end and beginning of a configuration's names
THRESHOLD, TOLERANCE, VOLUME = "threshold_db", "tolerance", "z"


def write_treated(folder: Path, image: Callable[[Config], DepthMap], settings: Config, own: DepthMap) -> None:
    """Write the maps of every treatment → ALIKE. image: makes the capture's depth map by a configuration of the method;
    own: the one by its own `settings`."""
    made: dict[str, DepthMap] = {settings.model_dump_json(): own}
    arrays: dict[str, np.ndarray] = {}
    known = type(settings).model_fields
    filters = [name for name in known if name.endswith(FILTERS)]
    kept = dict.fromkeys((name for name in known if name.startswith(DROPS)), False)  # no pixel is left out in doubt
    for treatment, size_px in SMOOTHING.items():
        for opened in (False, True):
            changed: dict[str, Any] = {**kept, **dict.fromkeys(filters, size_px)}
            if opened and THRESHOLD in known:
                changed[THRESHOLD] = min(OPEN_DB, getattr(settings, THRESHOLD))
            if opened and filters and TOLERANCE in known and VOLUME not in known:
                changed[TOLERANCE] = None  # weak pixels' depths are so wild that a plan of their box costs more
            config = settings.model_copy(update=changed)
            if (key := config.model_dump_json()) not in made:
                made[key] = image(config)
            depth = made[key]
            z_m = depth.z_m if filters else masked_mean(depth.z_m, size_px)
            arrays[f"{treatment}_{'open_' * opened}z_m"] = z_m.astype(np.float32)
            if opened:
                arrays[f"{treatment}_open_db"] = depth.amplitude_db
    write_npz(folder / ALIKE, **arrays)


def read_treated(folder: Path) -> dict[str, Alike] | None:
    """The maps by treatment; None where none were made."""
    if not (folder / ALIKE).exists():
        return None
    kept = read_npz(folder / ALIKE, tuple(f"{t}_{field}" for t in SMOOTHING for field in Alike._fields))
    return {t: Alike(*(kept[f"{t}_{field}"] for field in Alike._fields)) for t in SMOOTHING}
