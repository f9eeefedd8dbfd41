"""Trust in depths: p_gross is calibrated on random scenes of some kinds, and tested on those of other kinds, on hands,
and on scenes of a generator that the calibration never saw.

A pixel is wrong where its depth is more than 5 mm from the nearest depth that the true surface has within the pixel's
resolution cell: a depth between two surfaces is wrong. What is measured shares the features with the product, and the
truth with nothing that the methods know.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np

from bench.studies.columns import Record, Table, columns
from bench.studies.study import Study
from bench.studies.trust.cases import BLOCK, CALIBRATED, LADDER_HZ, Case, cases, known
from bench.studies.trust.figure import draw
from bench.studies.trust.fit import DROPPED_PERCENT, brier, fitted, reliability, silent_percent
from radar.data.depthmap import DepthMap
from radar.methods.registry import method
from radar.methods.trust import FEATURES, FLAGGED, GROSS_M, WEIGHTS, features, known_weights, probability, weights_of
from radar.support.errors import HandbenchError
from radar.support.files import write_text

FSK = ("2fsk", "3fsk", "3fsk-plus", "nfsk", "nfsk-plus")
VOLUMES = ("broadband", "broadband-aligned", "narrowband")
METHODS = (*FSK, *VOLUMES)
VOLUMES_EVERY = 3  # of the blocks of one scene of each kind, volumes are formed of these alone: they take longest
TAMPERED_EVERY = 5  # of these blocks: calibrating maps in which some depths are moved
MOVED_M, MOVED_PX = (0.01, 0.08), 3  # by how much, and within which radius
SILENT = 0.01  # p_gross below which nobody doubts a depth
OFF_CENTRE_M = 0.015  # of a volume from the target's middle, at most
HANDS, ASSORTED = 40, 100  # scenes of points to one hand, and to one assorted scene


def study(work: Path, scenes: int, methods: str, captures: list[Path], fit: bool, seed: int) -> Study:
    """So many scenes of points, a few hands and assorted scenes to them, and captures."""
    chosen = tuple(methods.split(",")) if methods else METHODS
    return Study(
        "trust",
        "Trust in depths",
        cases(scenes, -(-scenes // HANDS), -(-scenes // ASSORTED), captures),
        lambda case: measured(case, chosen, seed, work),
        partial(tables, fit=fit),
        draw,
        seed=seed,
        text=(__doc__ or "").partition("\n\n")[2],
    )


def measured(case: Case, methods: tuple[str, ...], seed: int, work: Path) -> list[Record]:
    """The pixels of one scene, by each method: their features, which are wrong, and which the method flags."""
    scene, rng, records = known(case, seed, work), np.random.default_rng([seed, case.number]), []
    for id in methods:
        middle_m = scene.middle_m + rng.uniform(-OFF_CENTRE_M, OFF_CENTRE_M)
        swept = len(scene.capture.frequencies_hz) > len(LADDER_HZ)
        seldom = case.family == "points" and case.number // BLOCK % VOLUMES_EVERY
        if id in VOLUMES and (seldom or (id != "narrowband" and not swept)):
            continue
        config, start = method(id).configure(scene.values(id, middle_m), str(case)), time.perf_counter()
        try:
            depth = method(id).run(scene.capture, config, 0).depth
        except HandbenchError:  # refused: no map, no wrong depth
            continue
        if calibrates(case.family, case.kind) and case.number // BLOCK % TAMPERED_EVERY == TAMPERED_EVERY - 1:
            depth = tampered(depth, rng)
        between = time.perf_counter()
        index, found = features(depth, scene.capture, config)
        end = time.perf_counter()
        wrong = scene.off_m(depth).ravel()[index] > GROSS_M
        flag = np.zeros(depth.z_m.shape, bool) if depth.wrapped is None else depth.wrapped
        seconds = {"method_s": between - start, "trust_s": end - between}
        pixels = {"found": found.astype(np.float32), "wrong": wrong, "flag": flag.ravel()[index]}
        records.append(
            {"family": case.family, "kind": case.kind, "number": case.number, "method": id} | pixels | seconds
        )
    return records


def tampered(depth: DepthMap, rng: np.random.Generator) -> DepthMap:
    """The map with the depths about one of its pixels put off, as a wrong period would, of which neither its σ nor its
    flags know."""
    on = np.flatnonzero(np.isfinite(depth.z_m))
    if not len(on):
        return depth
    row, column = np.unravel_index(rng.choice(on), depth.z_m.shape)
    y, x = np.ogrid[: depth.z_m.shape[0], : depth.z_m.shape[1]]
    moved_m = rng.uniform(*MOVED_M) * rng.choice([-1, 1])
    return replace(depth, z_m=depth.z_m + np.where(np.hypot(y - row, x - column) <= MOVED_PX, moved_m, 0.0))


def calibrates(family: str, kind: str) -> bool:
    """True for scenes that the weights are fitted to."""
    return family == "points" and kind.split(", ")[-1] in CALIBRATED


def group(record: Record) -> str:
    """The part of the study that a record belongs to."""
    if calibrates(record["family"], record["kind"]):
        return "calibration"
    return "other surfaces" if record["family"] == "points" else str(record["family"])


def tables(records: list[Record], fit: bool) -> list[Table]:
    """Figures by method and group, their reliability, and the weights."""
    methods = list(dict.fromkeys(record["method"] for record in records))
    of = {id: [r for r in records if r["method"] == id and len(r["wrong"])] for id in methods}
    weights = {id: fitted(*_pooled(rs)) for id, rs in of.items()} if fit else {id: weights_of(id) for id in methods}
    if fit:
        whole = [record for rs in of.values() for record in rs]
        write_text(WEIGHTS, as_toml(known_weights() | weights | {"any": fitted(*_pooled(whole))}))
    rows, bins = [], []
    for id, rs in of.items():
        for name, part in groupby(sorted(rs, key=group), group):
            these = list(part)
            facts = {"method": id, "group": name}
            p = [probability(r["found"].astype(np.float64), weights[id]) for r in these]
            rows.append(facts | figures(p, [r["wrong"] for r in these], [r["flag"] for r in these]) | _cost(these))
            told = reliability(np.concatenate(p), np.concatenate([r["wrong"] for r in these]))
            bins += [facts | {"p_gross": mean, "wrong": share, "pixels": count} for mean, share, count in told]
    named = [
        {"method": id, "feature": n, "weight": w}
        for id in of
        for n, w in zip(("constant", *FEATURES), weights[id], strict=True)
    ]
    return [
        Table("rows", columns("trust.rows"), rows, by="group"),
        Table("reliability", columns("trust.reliability"), bins, shown=False),
        Table("weights", columns("trust.weights"), named, shown=False),
    ]


def figures(p: list[np.ndarray], wrong: list[np.ndarray], flag: list[np.ndarray]) -> Record:
    """The worth of p_gross in some scenes, of each of which there are p [n], wrong [n] and the method's flag [n]."""
    silent = np.sort([np.count_nonzero(w & (q < SILENT)) for q, w in zip(p, wrong, strict=True)])[::-1]
    every, off, old = np.concatenate(p), np.concatenate(wrong), np.concatenate(flag)
    left = dict(zip((f"left_{d}_percent" for d in DROPPED_PERCENT), silent_percent(every, off), strict=True))
    return {
        "scenes": len(p),
        "pixels": len(off),
        "wrong_percent": 100 * float(off.mean()),
        "brier": brier(every, off),
        "brier_constant": float(off.mean() * (1 - off.mean())),
        **left,
        "doubted_percent": 100 * float(np.mean(every >= SILENT)),
        "silent_percent": 100 * float(np.mean(off & (every < SILENT))),
        "concentrated_percent": 100 * float(silent[: -(-len(silent) // 10)].sum() / max(silent.sum(), 1)),
        **_flagged("", every > FLAGGED, off),
        **_flagged("old_", old, off),
    }


def _flagged(which: str, flag: np.ndarray, wrong: np.ndarray) -> Record:
    both = np.count_nonzero(flag & wrong)
    precision, recall = (100 * both / n if n else None for n in map(np.count_nonzero, (flag, wrong)))
    return {f"{which}precision_percent": precision, f"{which}recall_percent": recall}


def _cost(records: list[Record]) -> Record:
    return {
        name.replace("_s", "_ms"): 1e3 * float(np.median([r[name] for r in records]))
        for name in ("method_s", "trust_s")
    }


def _pooled(records: list[Record]) -> tuple[np.ndarray, np.ndarray]:
    """Features [n, k] and wrong [n] of the scenes that calibrate."""
    known_to = [r for r in records if group(r) == "calibration"]
    if not known_to:
        raise HandbenchError("study trust: no scene calibrates; ask for more --scenes, or leave out --only")
    return np.concatenate([r["found"] for r in known_to]).astype(np.float64), np.concatenate(
        [r["wrong"] for r in known_to]
    )


def as_toml(weights: dict[str, np.ndarray]) -> str:
    """The file of weights [1 + k] by method."""
    lines = ["# Weights of radar/methods/trust.py, written by `handbench study trust --fit`, which tells of what."]
    for id, values in weights.items():
        lines += ["", f"[{id}]", *(f"{n} = {w:.4f}" for n, w in zip(("constant", *FEATURES), values, strict=True))]
    return "\n".join(lines) + "\n"
