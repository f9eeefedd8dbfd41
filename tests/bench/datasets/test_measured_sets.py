"""Measured echoes of others, by the mappings of docs/real_data.py, against their truths."""

from pathlib import Path

import numpy as np
import pytest

import handbench as hb
from docs.real_data import TUMOURS_M, advanced, gather, imaged, ring_delays_m
from handbench.bench.datasets.dataset import open_capture

SHARED = Path(__file__).parents[3].parent / "shared" / "data"


def captures(name: str, folder: Path) -> Path:
    """The folder, with the captures of a set of SHARED in it."""
    if not (SHARED / name).is_dir():
        pytest.skip(f"no {SHARED / name}")
    gather(SHARED / name, folder)
    return folder


def test_a_flat_tape_is_flat_and_at_its_distance(tmp_path):
    depth = hb.load(captures("copper_tape", tmp_path) / "tape").reconstruct("3fsk")
    strong = np.isfinite(depth.z_m) & (depth.amplitude_db >= -6)
    assert strong.sum() > 50
    assert depth.z_m[strong].std() < 1.6e-3
    assert np.median(depth.z_m[strong]) == pytest.approx(0.15, abs=0.01)


@pytest.mark.slow
def test_delays_from_one_tumour_bring_the_other_to_its_place(tmp_path):
    folder = captures("merit", tmp_path)
    (first, at_m), (second, truth_m) = TUMOURS_M.items()
    delays_m = ring_delays_m(open_capture(folder / first).echoes(), at_m)
    echoes = advanced(open_capture(folder / second).echoes(), delays_m)
    depth = imaged(folder / second, echoes)
    row, column = np.unravel_index(depth.amplitude_db.argmax(), depth.z_m.shape)
    peak_m = np.array([depth.x_m[column], depth.y_m[row], depth.z_m[row, column]])
    assert np.linalg.norm(peak_m - truth_m) <= 6e-3
