"""Trust in depths: p_gross is calibrated on some random scenes and hands, and tested on other
surfaces, on other hands, and on scenes of a generator that the calibration never saw.

A pixel is wrong where its depth is more than 5 mm from the nearest depth that the true surface has
within the pixel's resolution cell: a depth between two surfaces is wrong. What is measured shares
the features with the product, and the truth with nothing that the methods know. Scenes are kept in
the work folder: a study goes on where it stopped.

python -m tests.bench.studies.trust.measure_trust [--scenes N] [--methods A,B] [--captures CAPTURE
…] [--fit] [-o DIR]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from handbench.bench.evaluation.tables import declared_tables
from handbench.radar.data.depthmap import FLAGGED, DepthMap
from handbench.radar.methods import depth_uncertainty
from handbench.radar.methods.depth_uncertainty import (
    FEATURES,
    GROSS_M,
    WEIGHTS,
    features,
    known_weights,
    probability,
    weights_of,
)
from handbench.radar.methods.registry import method, method_key
from handbench.support.code_hash import key_of
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, read_npz, write_npz, write_text
from tests.bench.studies import script
from tests.bench.studies.columns import Record, Table
from tests.bench.studies.study import Study
from tests.bench.studies.trust.trust_cases import SWEPT, Case, cases, known
from tests.bench.studies.trust.worth import (
    DROPPED_PERCENT,
    draw,
    fitted,
    reliability,
    silent_percent,
)

SCHEMAS = declared_tables(__file__)
FSK = ("2fsk", "3fsk", "3fsk-plus", "nfsk", "nfsk-plus", "joint", "prior-2fsk")
VOLUMES = ("broadband", "broadband-aligned", "broadband-capon", "broadband-coherence", "narrowband")
VOLUMES_EVERY = 5  # scenes of points, volumes are formed of one alone: they take longest
SILENT = 0.01  # p_gross below which nobody doubts a depth
HANDS, ASSORTED = 10, 30  # scenes of points to one hand, and to one assorted scene
MOVED_EVERY, MOVED_M, MOVED_PX = (
    2,
    (0.01, 0.08),
    3,
)  # rounds of kinds: calibrating maps in which some depths move
PARTS = ("found", "wrong", "flag", "held")
SCENES = (
    "trust.trust_cases",
    "ablation.assorted_scenes",
    "stability.random_scenes",
)  # modules beside this one


def study(
    work: Path, scenes: int, methods: str, captures: list[Path], fit: bool, seed: int
) -> Study:
    """So many scenes of points, some hands and assorted scenes to them, and captures."""
    chosen = tuple(methods.split(",")) if methods else FSK + VOLUMES
    features_hash = content_hash(Path(depth_uncertainty.__file__))
    code = [
        *(key_of(f"tests.bench.studies.{name}") for name in SCENES),
        features_hash,
        *map(method_key, chosen),
    ]
    folder = work / content_hash(*code, *chosen, seed, fit)[:16]
    drawn = cases(scenes, -(-scenes // HANDS), -(-scenes // ASSORTED), captures)
    measure = partial(measured, methods=chosen, seed=seed, work=folder, fit=fit)
    text = (__doc__ or "").split("\n\n")[1]
    return Study(
        "trust",
        "Trust in depths",
        drawn,
        measure,
        partial(tables, fit=fit),
        draw,
        seed=seed,
        text=text,
    )


def measured(
    case: Case, methods: tuple[str, ...], seed: int, work: Path, fit: bool
) -> list[Record]:
    """The pixels of one scene, by each method: features found [n, k], which are wrong [n], which
    the method flags, and whether 2σ holds the error (1, 0; −1: unknown). Where weights are fitted,
    some calibrating depths are moved."""
    content = content_hash(Path(case.kind)) if case.family == "captures" else ""
    file = work / f"{case.family}-{content_hash(str(case), content)[:12]}.npz"
    if not file.is_file():
        write_npz(file, **_pixels(case, methods, seed, work, fit))
    kept = read_npz(file, (), tuple(f"{id} {part}" for id in methods for part in PARTS))
    facts, there = (
        {"group": case.group, "family": case.family},
        [id for id in methods if f"{id} wrong" in kept],
    )
    return [facts | {"method": id} | {part: kept[f"{id} {part}"] for part in PARTS} for id in there]


def _pixels(
    case: Case, methods: tuple[str, ...], seed: int, work: Path, fit: bool
) -> dict[str, np.ndarray]:
    scene, found = known(case, seed, work), dict[str, np.ndarray]()
    for id in methods:
        few = len(scene.capture.frequencies_hz) < SWEPT // 2
        if id in VOLUMES and (few or (case.family == "points" and case.number % VOLUMES_EVERY)):
            continue
        config = method(id).configure(scene.values(id), str(case))
        try:
            depth = method(id).run(scene.capture, config, 0).depth
        except HandbenchError:  # refused: no map, no wrong depth
            continue
        if (
            fit
            and case.group == "calibration"
            and case.family == "points"
            and case.number // 20 % MOVED_EVERY == 0
        ):
            depth = moved(depth, case.number)
        index, values = features(depth, scene.capture, config)
        nearest_m, own_m = (off_m.ravel()[index] for off_m in scene.off_m(depth))
        flag, sigma_m = (
            np.zeros(len(index)) if told is None else told.ravel()[index]
            for told in (depth.wrapped, depth.sigma_m)
        )
        held = np.where(np.isfinite(own_m) & (sigma_m > 0), own_m <= 2 * sigma_m, -1).astype(
            np.int8
        )
        pixels = (values.astype(np.float16), nearest_m > GROSS_M, flag > 0, held)
        found |= {f"{id} {part}": value for part, value in zip(PARTS, pixels, strict=True)}
    return found


def moved(depth: DepthMap, seed: int) -> DepthMap:
    """The map with the depths about one of its pixels put off, as a wrong period would, of which
    neither its σ nor its flags know."""
    rng, on = np.random.default_rng(seed), np.argwhere(np.isfinite(depth.z_m))
    row, column = rng.choice(on) if len(on) else (0, 0)
    y, x = np.ogrid[: depth.z_m.shape[0], : depth.z_m.shape[1]]
    off_m = (
        rng.uniform(*MOVED_M) * rng.choice([-1, 1]) * (np.hypot(y - row, x - column) <= MOVED_PX)
    )
    return replace(depth, z_m=depth.z_m + off_m)


def tables(records: list[Record], fit: bool) -> list[Table]:
    """Figures by group and method, and their reliability; the weights are fitted anew and written
    if so wished."""
    rows, bins, by, weights = [], [], itemgetter("group", "method"), {}
    records = [record for record in records if len(record["wrong"])]
    if fit:
        weights = {
            id: _fitted([r for r in records if r["method"] == id])
            for id in {r["method"] for r in records}
        }
        weights = known_weights() | dict(sorted(weights.items())) | {"any": _fitted(records)}
        write_text(WEIGHTS, as_toml(weights))
    for (group, id), part in groupby(sorted(records, key=by), by):
        these, facts, used = (
            list(part),
            {"group": group, "method": id},
            weights.get(id, weights_of(id)),
        )
        p = [probability(r["found"].astype(np.float64), used) for r in these]
        rows.append(facts | figures(p, *([r[name] for r in these] for name in PARTS[1:])))
        told = reliability(np.concatenate(p), np.concatenate([r["wrong"] for r in these]))
        bins += [
            facts | {"p_gross": mean, "wrong": share, "pixels": count}
            for mean, share, count in told
        ]
    shown = Table("rows", SCHEMAS["rows"].columns, rows, by="group")
    return [shown, Table("reliability", SCHEMAS["reliability"].columns, bins, shown=False)]


def figures(
    p: list[np.ndarray], wrong: list[np.ndarray], flag: list[np.ndarray], held: list[np.ndarray]
) -> Record:
    """The worth of p_gross and of σ in some scenes, of each of which there are p, wrong, flag and
    held, [n] each."""
    silent = np.sort([np.count_nonzero(w & (q < SILENT)) for q, w in zip(p, wrong, strict=True)])[
        ::-1
    ]
    every, off, flagged, within = map(np.concatenate, (p, wrong, flag, held))
    told: Record = {
        "scenes": len(p),
        "pixels": len(off),
        "brier": float(np.mean((every - off) ** 2)),
    }
    told |= zip(
        (f"left_{d}_percent" for d in DROPPED_PERCENT), silent_percent(every, off), strict=True
    )
    told["doubted_percent"] = 100 * float(np.mean(every >= SILENT))
    told["silent_percent"] = _percent(silent.sum(), len(off))
    told["concentrated_percent"] = _percent(silent[: -(-len(silent) // 10)].sum(), silent.sum())
    told["held_percent"] = _percent((within > 0).sum(), (within >= 0).sum())
    for name, chosen in (("", every > FLAGGED), ("old_", flagged)):
        told[f"{name}precision_percent"] = _percent((chosen & off).sum(), chosen.sum())
        told[f"{name}recall_percent"] = _percent((chosen & off).sum(), off.sum())
    return told


def _percent(part: int, whole: int) -> float | None:
    return 100 * float(part) / float(whole) if whole else None


def _fitted(records: list[Record]) -> np.ndarray:
    """The weights that calibrating scenes have, points and hands alike in all."""
    families = [
        [r for r in records if r["group"] == "calibration" and r["family"] == f]
        for f in ("points", "hands")
    ]
    counts = [sum(len(r["wrong"]) for r in family) for family in families]
    if not sum(counts):
        raise HandbenchError("--fit: no calibrating scene was measured; give more --scenes")
    found, wrong = (
        np.concatenate([r[name] for family in families for r in family])
        for name in ("found", "wrong")
    )
    return fitted(
        found.astype(np.float64), wrong, np.repeat([1 / max(count, 1) for count in counts], counts)
    )


def as_toml(weights: dict[str, np.ndarray]) -> str:
    """The file of weights [1 + k] by method."""
    parts = [
        "# Weights of p_gross, written by `tests/bench/studies/trust/measure_trust.py --fit`.\n"
    ]
    for id, values in weights.items():
        parts += [
            f"\n[{id}]\n",
            *(f"{n} = {w:.4f}\n" for n, w in zip(("constant", *FEATURES), values, strict=True)),
        ]
    return "".join(parts)


def main() -> None:
    """Measure, write the files of a study, print the tables."""
    prog = "python -m tests.bench.studies.trust.measure_trust"
    purpose = (
        "whether p_gross is honest: calibrated on some random scenes and hands, tested on others"
    )
    parser = argparse.ArgumentParser(prog=prog, description=purpose)
    count = "random scenes of points; one hand to 10, one assorted scene to 30 (default 240)"
    parser.add_argument("--scenes", type=int, default=240, help=count)
    parser.add_argument(
        "--methods", default="", help="ids, separated by commas (default: twelve that differ)"
    )
    folders = "folders with truth.ply, imaged at the methods' defaults"
    parser.add_argument(
        "--captures", nargs="*", type=Path, default=[], metavar="CAPTURE", help=folders
    )
    weights = "fit the weights anew and write them to radar/methods/trust.toml"
    parser.add_argument("--fit", action="store_true", help=weights)
    parser.add_argument(
        "--seed", type=int, default=0, help="of the scenes (default 0); the weights stand on 0"
    )
    script.measured(parser, study, "trust")


if __name__ == "__main__":
    main()
