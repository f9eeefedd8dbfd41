"""How often self-calibration's 95 % intervals hold planted errors, over captures that are drawn.

python -m tests.calibration.echoes.measure_self_calibration [--captures 200] [--seed 0] [-o DIR]
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from handbench.bench.evaluation.tables import Column
from handbench.bench.studies.study import Record, Study, Table, measured
from handbench.calibration.echoes.estimate import self_calibrate
from handbench.support.errors import HandbenchError
from handbench.support.progress import track
from tests.calibration.echoes.planted import Planted, planted

COLUMNS = (
    Column("quantity", str, "what is estimated", heading="quantity"),
    Column("captures", int, "of which it is unknown", heading="captures"),
    Column("determined", int, "in which it is determined", heading="determined"),
    Column("held_percent", float, "of those whose interval holds the truth", heading="held %"),
    Column("sigma", float, "median standard deviation of those", heading="median σ", form="{:.2g}"),
)
EACH = (
    Column("seed", int, "of the drawn capture", heading="seed"),
    Column("quantity", str, "what is estimated", heading="quantity"),
    Column("error", float, "estimate less truth", heading="error", form="{:.3g}"),
    Column("sigma", float, "standard deviation", heading="σ", form="{:.3g}"),
    Column("half_width", float, "of the 95 % interval", heading="±", form="{:.3g}"),
    Column("determined", str, "whether it is determined", heading="determined"),
)


def study(work: Path, captures: int, seed: int) -> Study:
    """All captures are one case, which is measured by as many processes as there are cores."""
    return Study(
        "self-calibration",
        [f"{captures} captures"],
        lambda _: measure(range(seed, seed + captures)),
        lambda records: [Table("rows", COLUMNS, summary(records)), Table("each", EACH, records)],
        seed=seed,
    )


def measure(seeds: range) -> list[Record]:
    """A record for each capture and each quantity that is unknown of it."""
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        found = list(track(pool.map(errors, seeds), "self-calibration", total=len(seeds)))
    return [record for records in found for record in records]


def errors(seed: int) -> list[Record]:
    """Estimate one drawn capture's unknowns and compare them with the planted ones; nothing where
    no echo stands out from the noise."""
    truth = planted(seed)
    try:
        found = self_calibrate(truth.capture, truth.unknown)
    except HandbenchError:
        return []
    true = truths(truth, found.period_m)
    return [
        {
            "seed": seed,
            "quantity": name,
            "error": estimate.value - true[name],
            "sigma": estimate.sigma,
            "half_width": estimate.half_width,
            "determined": "yes" if estimate.determined else "no",
        }
        for name, estimate in found.estimates.items()
        if name in true
    ]


def truths(truth: Planted, period_m: float) -> dict[str, float]:
    """The planted values, by the estimates' names."""
    turns = np.rint(truth.offset_m / period_m)
    return {
        "range_offset_m": truth.offset_m - period_m * turns,
        "scan_step_x": truth.steps[0],
        "scan_step_y": truth.steps[1],
    }


def summary(records: list[Record]) -> list[Record]:
    """A record for each quantity."""
    rows = []
    for name in dict.fromkeys(record["quantity"] for record in records):
        own = [record for record in records if record["quantity"] == name]
        sure = [record for record in own if record["determined"] == "yes"]
        held = [abs(record["error"]) <= record["half_width"] for record in sure]
        rows.append(
            {
                "quantity": name,
                "captures": len(own),
                "determined": len(sure),
                "held_percent": 100 * float(np.mean(held)),
                "sigma": float(np.median([record["sigma"] for record in sure])),
            }
        )
    return rows


if __name__ == "__main__":
    options = argparse.ArgumentParser("python -m tests.calibration.echoes.measure_self_calibration")
    options.add_argument("--captures", type=int, default=200)
    options.add_argument("--seed", type=int, default=0)
    measured(options, study, "self-calibration")
