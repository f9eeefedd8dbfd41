"""The effects that photographs show, how far each moves the mesh, and the selection of those that a scene calls for."""

from __future__ import annotations

import time
from typing import Any

from bench.scenes.photo_pilot import Change, Pilot
from bench.scenes.photographs import Studio
from bench.scenes.scene_file import Photos
from radar.simulation.selection import Choice

PREFIX = "photos."  # before the name of an effect, in tables
NO_NOISE_E = 1e12  # electrons at white at which photon noise is far below a step of 8 bits
WITHOUT: dict[str, dict[str, Any]] = {
    "highlights": {"highlights": 0.0},
    "speckle": {"speckle": 0.0},
    "defocus": {"f_number": None},
    "blur": {"blur_px": 0.0},
    "motion": {"motion_px": 0.0},
    "exposure": {"exposure_spread": 0.0},
    "white_balance": {"white_balance_spread": 0.0},
    "noise": {"full_well_e": NO_NOISE_E, "read_noise_e": 0.0},
}


def without(photos: Photos, *effects: str) -> Photos:
    """The photographs without some effects."""
    return photos.model_copy(update={key: value for name in effects for key, value in WITHOUT[name].items()})


def choose(studio: Studio, explain: bool = False) -> tuple[Photos, tuple[Choice, ...]]:
    """The photographs to take, and every effect's row after one for all. explain: give estimates for "all" too."""
    photos, started_s = studio.photos, time.process_time()
    there = [name for name in WITHOUT if without(photos, name) != photos]
    changes, left_out, rows = {}, {}, []
    if explain or photos.effects == "auto":
        pilot = Pilot(studio)
        changes = {name: pilot.change(without(photos, name), photos) for name in there}
        took_s = time.process_time() - started_s
        why = f"estimates: {took_s:.1f} s of processor; {pilot.sights.points} points, {len(pilot.sights.point)} windows"
        rows.append(Choice(effect="photos", on=True, why=why, seconds=took_s))
    if photos.effects == "auto":
        left_out = _negligible(changes, photos.tolerance_mm)
    rows += [_row(name, name in there, photos, changes.get(name), left_out.get(name)) for name in WITHOUT]
    return without(photos, *left_out), tuple(rows)


def _negligible(changes: dict[str, Change], tolerance_mm: float) -> dict[str, str]:
    """Effects that may be left out, and why: the smallest, while their sum stays below the tolerance; none that
    decides whether a point is matched at all."""
    result: dict[str, str] = {}
    spent_mm = 0.0
    for name, change in sorted(changes.items(), key=lambda item: item[1].depth_mm):
        if change.lost or change.gained:
            continue
        spent_mm += change.depth_mm
        if spent_mm >= tolerance_mm:
            break
        result[name] = f"with all that is smaller {spent_mm:.4f} of {tolerance_mm:g} mm"
    return result


def _row(name: str, there: bool, photos: Photos, change: Change | None, left_out: str | None) -> Choice:
    effect = PREFIX + name
    if not there:
        return Choice(effect=effect, on=False, why=f"needs photos.{next(iter(WITHOUT[name]))}")
    why = left_out or ("called for" if photos.effects == "auto" else "all that are named are on")
    if change is None:
        return Choice(effect=effect, on=True, why=why)
    why += f" (windows matched with and without it: {100 * change.lost:.0f} % lost, {100 * change.gained:.0f} % gained)"
    percent = 100 * (change.lost + change.gained)
    return Choice(effect=effect, on=left_out is None, why=why, depth_mm=change.depth_mm, pixels_percent=percent)
