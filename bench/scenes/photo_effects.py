"""The effects that photographs show, how far each moves the mesh, and the selection of those that a scene calls for."""

import time
from typing import Any

from bench.scenes.photo_pilot import Change, Pilot
from bench.scenes.photographs import Studio
from bench.scenes.scene_file import Photos
from radar.simulation.selection import Choice
from radar.support.errors import HandbenchError

PREFIX = "photos."  # before the name of an effect, in tables
BY_CHANCE = 0.03  # of the points, one of 40: matched or not by a hair
WITHOUT: dict[str, dict[str, Any]] = {
    "highlights": {"highlights": 0.0},
    "speckle": {"speckle": 0.0},
    "defocus": {"f_number": None},
    "blur": {"blur_px": 0.0},
    "motion": {"motion_px": 0.0},
    "exposure": {"exposure_spread": 0.0},
    "white_balance": {"white_balance_spread": 0.0},
    "noise": {"full_well_e": 1e12, "read_noise_e": 0.0},  # far below a step of 8 bits
}


def without(photos: Photos, *effects: str) -> Photos:
    """The photographs without some effects."""
    return photos.model_copy(update={key: value for name in effects for key, value in WITHOUT[name].items()})


def choose(studio: Studio, explain: bool = False) -> tuple[Photos, tuple[Choice, ...]]:
    """The photographs to take, and every effect's row. explain: give estimates where none is asked for, too."""
    photos, started_s = studio.photos, time.process_time()
    changes: dict[str, Change] = {}
    rows: list[Choice] = []
    if explain or photos.effects == "auto":
        try:
            pilot = Pilot(studio)
            there = (name for name in WITHOUT if without(photos, name) != photos)
            changes = {name: pilot.change(without(photos, name), photos) for name in there}
            why = f"estimates of {pilot.shape[0]} points, {len(pilot.point)} windows; seconds of the processor"
        except HandbenchError as error:
            why = f"no estimates; {error}"
        rows.append(Choice(effect="photos", on=True, why=why, seconds=time.process_time() - started_s))
    left_out = _negligible(changes, photos.tolerance_mm) if photos.effects == "auto" else {}
    rows += [_row(name, photos, changes.get(name), left_out.get(name, "")) for name in WITHOUT]
    return without(photos, *left_out), tuple(rows)


def _negligible(changes: dict[str, Change], tolerance_mm: float) -> dict[str, str]:
    """Effects that may be left out, and why: the smallest, while their sum stays below the tolerance; none that
    decides whether points are matched at all."""
    result, spent_mm = dict[str, str](), 0.0
    for name, change in sorted(changes.items(), key=lambda item: item[1].depth_mm):
        if change.lost + change.gained <= BY_CHANCE:
            spent_mm += change.depth_mm
            if spent_mm < tolerance_mm:
                result[name] = f"with all that is smaller {spent_mm:.4f} of {tolerance_mm:g} mm"
    return result


def _row(name: str, photos: Photos, change: Change | None, left_out: str) -> Choice:
    if without(photos, name) == photos:
        return Choice(effect=PREFIX + name, on=False, why=f"needs photos.{next(iter(WITHOUT[name]))}")
    why = left_out or ("called for" if photos.effects == "auto" else "all that are named are on")
    if change is None:
        return Choice(effect=PREFIX + name, on=True, why=why)
    why += f" (windows matched with and without: {100 * change.lost:.0f} % lost, {100 * change.gained:.0f} % gained)"
    percent = 100 * (change.lost + change.gained)
    return Choice(effect=PREFIX + name, on=not left_out, why=why, depth_mm=change.depth_mm, pixels_percent=percent)
