"""Study of p_gross, the predicted probability that a pixel's depth is grossly wrong.

Its weights are fitted to some random scenes and hands, and tested on other surfaces, on other
hands, and on scenes of a generator that was not used in the fit. A pixel is wrong if its depth
differs by more than 5 mm from every depth of the true surface within the pixel's resolution cell; a
depth between two surfaces is therefore wrong. The features are computed by the same code as in the
product; the truth is independent of everything that the methods know.

    python -m handbench.bench.studies.trust.measure_trust
        [--scenes N] [--methods A,B] [--captures CAPTURE …] [--fit]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from handbench.bench.studies.trust.trust_cases import SWEPT, TrustCase, cases, known
from handbench.radar.data.depthmap import FLAGGED, DepthMap
from handbench.radar.methods.depth_uncertainty import (
    FEATURES,
    GROSS_M,
    WEIGHTS,
    features,
    known_weights,
    probability,
    weights_of,
)
from handbench.radar.methods.registry import method
from handbench.radar.warmup import compile_kernels
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json, write_text
from handbench.support.progress import track

Record = dict[str, Any]
FSK = ("2fsk", "3fsk", "3fsk-plus", "nfsk", "nfsk-plus", "joint")
VOLUMES = ("broadband", "broadband-aligned", "narrowband")
VOLUMES_EVERY = 5  # scenes of points, volumes are formed of one alone: they take longest
SILENT = 0.01  # p_gross below which nobody doubts a depth
HANDS, ASSORTED = 10, 30  # scenes of points to one hand, and to one assorted scene
# every second round of kinds: calibrating maps in which some depths move
MOVED_EVERY, MOVED_M, MOVED_PX = 2, (0.01, 0.08), 3
# of a squared standardised weight: keeps features that say the same from large opposite weights
PENALTY = 1e-4
BINS = np.array([0, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0])
DROPPED_PERCENT = (0, 1, 2, 5, 10, 15, 20)


def pixels(
    case: TrustCase, methods: tuple[str, ...], seed: int, work: Path, fit: bool
) -> list[Record]:
    """Image one scene with each method. Returns a record for each, with the following arrays over
    its n pixels that have a depth.

    found [n, k]: the features from which p_gross, the probability of a gross error, is predicted.
    wrong [n]: True if the depth error exceeds 5 mm (GROSS_M). held [n]: 1 if the error is below 2σ,
    0 if not, −1 if unknown. fit: True if weights will be fitted; then, in some of the scenes for
    the fit, some depths are moved to wrong values.
    """
    scene, of_points, records = known(case, seed, work), case.family == "points", []
    few = len(scene.capture.frequencies_hz) < SWEPT // 2
    calibrating = of_points and case.group == "calibration"
    for id in methods:
        if id in VOLUMES and (few or (of_points and case.number % VOLUMES_EVERY)):
            continue
        config = method(id).configure(scene.values(id), str(case))
        try:
            depth = method(id).run(scene.capture, config, 0).depth
        except HandbenchError:  # refused: no map, no wrong depth
            continue
        if fit and calibrating and case.number // 20 % MOVED_EVERY == 0:
            depth = moved(depth, case.number)
        index, found = features(depth, scene.capture, config)
        nearest_m, own_m = (off_m.ravel()[index] for off_m in scene.off_m(depth))
        sigma_m = np.zeros(len(index)) if depth.sigma_m is None else depth.sigma_m.ravel()[index]
        held = np.where(np.isfinite(own_m) & (sigma_m > 0), own_m <= 2 * sigma_m, -1)
        records.append(
            {
                "group": case.group,
                "family": case.family,
                "method": id,
                "found": found.astype(np.float16),
                "wrong": nearest_m > GROSS_M,
                "held": held.astype(np.int8),
            }
        )
    return records


def moved(depth: DepthMap, seed: int) -> DepthMap:
    """Return a depth map in which the depths around one pixel are wrong by some centimetres, as
    after a wrong choice of the wavelength period. Its standard deviations and flags are unchanged.
    seed: of the pixel and the error."""
    rng, on = np.random.default_rng(seed), np.argwhere(np.isfinite(depth.z_m))
    row, column = rng.choice(on) if len(on) else (0, 0)
    y, x = np.ogrid[: depth.z_m.shape[0], : depth.z_m.shape[1]]
    near = np.hypot(y - row, x - column) <= MOVED_PX
    return replace(depth, z_m=depth.z_m + rng.uniform(*MOVED_M) * rng.choice([-1, 1]) * near)


def tables(records: list[Record], fit: bool) -> dict[str, list[Record]]:
    """Make two tables by group of scenes and method: "rows", how well p_gross predicts gross depth
    errors, and "reliability", predicted probability against the observed share of wrong pixels.

    records: one for each scene and method, with features and errors of its pixels. fit: True to fit
    the weights to the scenes for calibration first, and write them to trust.toml.
    """
    rows, bins, by, weights = [], [], itemgetter("group", "method"), {}
    records = [record for record in records if len(record["wrong"])]
    if fit:
        for id in sorted({record["method"] for record in records}):
            weights[id] = _fitted([r for r in records if r["method"] == id])
        weights = known_weights() | weights | {"any": _fitted(records)}
        write_text(WEIGHTS, as_toml(weights))
    for (group, id), part in groupby(sorted(records, key=by), by):
        these, facts = list(part), {"group": group, "method": id}
        used = weights[id] if id in weights else weights_of(id)
        p = [probability(record["found"].astype(np.float64), used) for record in these]
        rows.append(facts | figures(p, these))
        wrong = np.concatenate([record["wrong"] for record in these])
        bins += [facts | one for one in reliability(np.concatenate(p), wrong)]
    return {"rows": rows, "reliability": bins}


def figures(p: list[np.ndarray], records: list[Record]) -> Record:
    """Compute how well p_gross and σ predict the errors in some scenes. Returns statistics by name.

    p: p_gross [n] of the pixels of each scene. records: errors of the pixels, for the same scenes.
    Among the statistics are the Brier score, the share of wrong pixels that remains after those
    with the highest p_gross are removed, precision and recall of the flag (p_gross above a limit),
    and the share of errors below 2σ.
    """
    wrong = [record["wrong"] for record in records]
    silent = np.sort([np.count_nonzero(w & (q < SILENT)) for q, w in zip(p, wrong, strict=True)])
    every, off = np.concatenate(p), np.concatenate(wrong)
    within = np.concatenate([record["held"] for record in records])
    doubted = every > FLAGGED
    trusted = off[np.argsort(every, kind="stable")]
    left = {d: trusted[: max(1, round(len(off) * (1 - d / 100)))] for d in DROPPED_PERCENT}
    return {
        "scenes": len(p),
        "pixels": len(off),
        "brier": float(np.mean((every - off) ** 2)),
        **{f"left_{dropped}_percent": 100 * float(some.mean()) for dropped, some in left.items()},
        "doubted_percent": 100 * float(np.mean(every >= SILENT)),
        "silent_percent": _percent(silent.sum(), len(off)),
        "concentrated_percent": _percent(silent[-len(silent) // 10 :].sum(), silent.sum()),
        "held_percent": _percent((within > 0).sum(), (within >= 0).sum()),
        "precision_percent": _percent((doubted & off).sum(), doubted.sum()),
        "recall_percent": _percent((doubted & off).sum(), off.sum()),
    }


def _percent(part: int, whole: int) -> float | None:
    return 100 * float(part) / float(whole) if whole else None


def reliability(p: np.ndarray, wrong: np.ndarray) -> list[Record]:
    """Compare predicted with observed probability in bins of p_gross.

    p [n]: p_gross of the pixels. wrong [n]: True if a pixel is grossly wrong. Returns a record for
    each bin with pixels: the mean p_gross, the share of wrong pixels, and the number of pixels.
    """
    place = np.clip(np.searchsorted(BINS, p, side="right") - 1, 0, len(BINS) - 2)
    return [
        {
            "p_gross": float(p[place == i].mean()),
            "wrong": float(wrong[place == i].mean()),
            "pixels": int((place == i).sum()),
        }
        for i in np.unique(place)
    ]


def _fitted(records: list[Record]) -> np.ndarray:
    """Fit the weights [1 + k] of p_gross, the constant first, to the scenes for calibration among
    the records. Scenes of points and hands get equal total weight. Raises HandbenchError if there
    is no such scene."""
    some = [r for r in records if r["group"] == "calibration"]
    if not some:
        raise HandbenchError(
            "--fit: none of the measured scenes is for calibration; measure more with --scenes"
        )
    counts = {
        r["family"]: sum(len(s["wrong"]) for s in some if s["family"] == r["family"]) for r in some
    }
    share = np.concatenate([np.full(len(r["wrong"]), 1 / counts[r["family"]]) for r in some])
    found = np.concatenate([r["found"] for r in some]).astype(np.float64)
    return fitted(found, np.concatenate([r["wrong"] for r in some]), share)


def fitted(found: np.ndarray, wrong: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Fit a logistic regression. Returns the weights [1 + k], the constant first, that make the
    observations `wrong` most likely.

    found [n, k]: features of the pixels. wrong [n]: True if a pixel is grossly wrong. share [n]:
    weight of each pixel in the likelihood. Large weights of standardised features are slightly
    penalised.
    """
    mean, scale = found.mean(axis=0), found.std(axis=0)
    scale = np.where(scale > 1e-6, scale, np.inf)  # what never changes gets no weight
    known = np.column_stack([np.ones(len(found)), (found - mean) / scale])
    sign, share = np.where(wrong, 1.0, -1.0), share / share.sum()

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        margin, penalised = sign * (known @ weights), np.r_[0.0, weights[1:]]
        slope = -share * sign / (1 + np.exp(np.clip(margin, -500, 500)))
        value = share @ np.logaddexp(0, -margin) + PENALTY * penalised @ penalised
        return float(value), slope @ known + 2 * PENALTY * penalised

    start, options = np.zeros(known.shape[1]), {"maxiter": 500}
    weights = minimize(loss, start, jac=True, method="L-BFGS-B", options=options).x
    slopes = weights[1:] / scale
    return np.r_[weights[0] - slopes @ mean, slopes]


def as_toml(weights: dict[str, np.ndarray]) -> str:
    """Return the text of trust.toml. weights: arrays [1 + k], the constant first, by method id."""
    command = "python -m handbench.bench.studies.trust.measure_trust --fit"
    lines = [f"# Weights of p_gross, written by `{command}`."]
    for id, values in weights.items():
        named = zip(("constant", *FEATURES), values, strict=True)
        lines += ["", f"[{id}]", *(f"{name} = {weight:.4f}" for name, weight in named)]
    return "\n".join([*lines, ""])


def main() -> None:
    """Measure whether p_gross, the predicted probability of a gross depth error, is right on scenes
    that it was not fitted to; print the table, and write it to OUT/trust.json."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    count = "random scenes of points; one hand to 10, one assorted scene to 30 (default 240)"
    parser.add_argument("--scenes", type=int, default=240, help=count)
    ids = "ids, separated by commas (default: nine that differ)"
    parser.add_argument("--methods", default=",".join(FSK + VOLUMES), help=ids)
    folders = "folders with truth.ply, imaged at the methods' defaults"
    parser.add_argument("--captures", nargs="*", type=Path, default=[], help=folders)
    weights = "fit the weights anew and write them to radar/methods/trust.toml"
    parser.add_argument("--fit", action="store_true", help=weights)
    seed = "of the scenes (default 0); the weights stand on 0"
    parser.add_argument("--seed", type=int, default=0, help=seed)
    parser.add_argument("--only", default="", help="scenes whose name has this text, as 'points'")
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/trust"))
    given = parser.parse_args()
    hands, assorted = -(-given.scenes // HANDS), -(-given.scenes // ASSORTED)
    every = cases(given.scenes, hands, assorted, given.captures)
    chosen, methods = [c for c in every if given.only in str(c)], tuple(given.methods.split(","))
    compile_kernels()
    try:
        records = [
            record
            for case in track(chosen, "trust")
            for record in pixels(case, methods, given.seed, given.out / "work", given.fit)
        ]
        found = tables(records, given.fit)
    except HandbenchError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    write_json(given.out / "trust.json", {"seed": given.seed, **found})
    print(pd.DataFrame(found["rows"]).to_string(index=False, float_format="{:.4g}".format))


if __name__ == "__main__":
    main()
