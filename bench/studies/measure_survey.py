"""Errors of estimated camera positions compared with a survey, for handbench and for COLMAP with
default options, from the same photographs.

The photographs are those of fountain-P11 (Strecha et al., CVPR 2008), or others in the same layout:
`images/`, `K.txt` and `cameras/NAME.camera`. Both programs get the same files and the same seed.
COLMAP runs with pycolmap's default options, except that a model may have only three images. If the
intrinsics K are given, its lens model is PINHOLE, and no intrinsics are refined.

    python -m handbench.bench.studies.measure_survey FOLDER
        [--counts 11,8,6,5] [--shrinks 1,2] [--choices first] [--seeds 1]

`--choices random --counts 11,9,8,7,6` takes all eleven photographs, and five random choices of each
smaller number.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from handbench.bench.evaluation.tables import declared_tables
from handbench.bench.studies.study import Record, Study, Table, measured, parser
from handbench.calibration.transforms import umeyama
from handbench.groundtruth.cameras.cameras import pycolmap, registered_images
from handbench.groundtruth.options import SparseOptions
from handbench.groundtruth.sparse.inputs import gather
from handbench.groundtruth.sparse.sparse import register
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, require_folder

Intrinsics = tuple[float, float, float, float]
CENTRE = slice(21, 24)  # among the numbers of a .camera file: after K, distortion and rotation
JPEG_QUALITY = 95
DRAWS = 5  # random choices of each number of photographs
PLAIN = ["plain COLMAP", "plain COLMAP, one camera"]  # with K and without


@dataclass(frozen=True)
class SurveyCase:
    """Photographs to reconstruct.

    names: of the photographs. choice: how they were chosen, in words. shrink: divisor of their
    width and height. known: True if the intrinsics K are given. seed: of both reconstructions.
    """

    names: tuple[str, ...]
    choice: str
    shrink: int
    known: bool
    seed: int

    def __str__(self) -> str:
        known = "K" if self.known else "no K"
        return f"{len(self.names)} {self.choice}, 1/{self.shrink}, {known}, seed {self.seed}"


def study(work: Path, photos: Path, counts: str, shrinks: str, choices: str, seeds: int) -> Study:
    """Make the study that compares camera positions, estimated by handbench and by COLMAP from the
    same photographs, with a survey.

    work: folder for shrunk photographs. photos: folder with images/, K.txt and cameras/. counts,
    shrinks, choices: lists separated by commas, of numbers of photographs, divisors of their size,
    and ways to choose them (first, last, spread, random). The cases are all combinations of these,
    of given and unknown intrinsics, and of the seeds 0 to seeds − 1.
    """
    centres_m = surveyed_centres_m(photos / "cameras")
    images = require_folder(photos / "images", "photographs")
    named = sorted(path.name for path in images.iterdir() if path.name in centres_m)
    cases = [
        SurveyCase(names, choice, shrink, known, seed)
        for shrink, count in product(map(int, shrinks.split(",")), map(int, counts.split(",")))
        for choice, names in _chosen(named, count, choices)
        for known, seed in product((True, False), range(seeds))
    ]
    return Study(
        "survey",
        cases,
        lambda case: measure(case, photos, centres_m, work),
        lambda records: [
            Table(name, declared_tables(__file__)[name].columns, rows)
            for name, rows in (("rows", records), ("ratios", ratios(records)))
        ],
    )


def _chosen(names: list[str], count: int, choices: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    if count >= len(names):
        yield "all", tuple(names)
        return
    spread = np.linspace(0, len(names) - 1, count).round().astype(int)
    known = {"first": range(count), "last": range(-count, 0), "spread": spread}
    for choice in choices.split(","):
        if choice == "random":
            for number, drawn in enumerate(_drawn(names, count), start=1):
                yield f"random {number}", drawn
        elif choice in known:
            yield choice, tuple(names[i] for i in known[choice])
        else:
            raise HandbenchError(
                f"--choices: is '{choice}'; expected first, last, spread or random"
            )


def _drawn(names: list[str], count: int) -> list[tuple[str, ...]]:
    """Draw different random choices of `count` names. The seed is their count."""
    random, drawn = np.random.default_rng(count), set[tuple[str, ...]]()
    while len(drawn) < min(DRAWS, math.comb(len(names), count)):
        drawn.add(tuple(sorted(random.choice(names, count, replace=False).tolist())))
    return sorted(drawn)


def surveyed_centres_m(folder: Path) -> dict[str, np.ndarray]:
    """Read the surveyed projection centres from Strecha's *.camera files. Returns centres [3] in
    metres, by the photograph's name."""
    files = sorted(require_folder(folder, "surveyed *.camera files").glob("*.camera"))
    return {
        file.name.removesuffix(".camera"): np.array(file.read_text().split(), float)[CENTRE]
        for file in files
    }


def centre_errors_m(
    model: pycolmap.Reconstruction, surveyed_m: dict[str, np.ndarray]
) -> np.ndarray:
    """Compute the distances [n] in metres between the centres of a model's registered cameras and
    the surveyed ones, after the best similarity transform of all centres. surveyed_m: centres [3]
    by the photograph's name."""
    ours = np.array([image.projection_center() for image in registered_images(model)])
    theirs = np.array([surveyed_m[image.name] for image in registered_images(model)])
    matrix = umeyama(ours, theirs, with_scale=True)
    return np.asarray(np.linalg.norm(ours @ matrix[:3, :3].T + matrix[:3, 3] - theirs, axis=1))


def measure(
    case: SurveyCase, photos: Path, centres_m: dict[str, np.ndarray], work: Path
) -> list[Record]:
    """Reconstruct the photographs of one case with handbench and with COLMAP. Returns a record of
    the errors for each.

    Without intrinsics, COLMAP runs twice: with one camera for all photographs, and with its default
    of one camera for each. photos: folder with images/ and K.txt. centres_m: surveyed centres [3]
    by the photograph's name. work: folder that keeps shrunk photographs.
    """
    K = np.array((photos / "K.txt").read_text().split(), float) / case.shrink
    intrinsics = (K[0], K[4], K[2], K[5]) if case.known else None
    kept = work / f"1-{case.shrink}"
    if not kept.is_dir():
        with atomic_folder(kept) as folder:
            _shrunk(photos / "images", sorted(centres_m), case.shrink, folder)
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        folder = Path(scratch) / "photos"
        folder.mkdir()
        for name in case.names:
            (folder / name).symlink_to((kept / name).resolve())
        models = {"handbench": ours(folder, intrinsics, case.seed)}
        ways = {", one camera": True, ", a camera each": False}
        for way, shared in ({"": True} if case.known else ways).items():
            found = plain(folder, Path(scratch) / f"{shared}.db", intrinsics, shared, case.seed)
            models[f"plain COLMAP{way}"] = found
        return [_record(case, way, model, centres_m) for way, model in models.items()]


def _shrunk(pictures: Path, names: list[str], shrink: int, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        if shrink == 1:
            shutil.copy(pictures / name, folder / name)
        else:
            with Image.open(pictures / name) as image:
                image.reduce(shrink).save(folder / name, quality=JPEG_QUALITY)


def ours(folder: Path, intrinsics: Intrinsics | None, seed: int) -> pycolmap.Reconstruction:
    """Reconstruct the cameras of a folder of photographs as `handbench groundtruth --unscaled`
    does, and return the sparse model. intrinsics: fx, fy, cx, cy in pixels (None: unknown)."""
    inputs, options = gather(folder, SparseOptions(intrinsics=intrinsics, unscaled=True, seed=seed))
    return register(inputs, options).model


def plain(
    folder: Path, database: Path, intrinsics: Intrinsics | None, shared: bool, seed: int
) -> pycolmap.Reconstruction:
    """Reconstruct the cameras of a folder of photographs with pycolmap's default steps, and return
    the model with the most photographs.

    database: file that COLMAP creates. intrinsics: fx, fy, cx, cy in pixels (None: unknown).
    shared: True for one camera that took all photographs, False for one camera each.
    """
    pycolmap.set_random_seed(seed)
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    reader = pycolmap.ImageReaderOptions()
    options = pycolmap.IncrementalPipelineOptions(min_model_size=3, random_seed=seed)
    if intrinsics is not None:
        reader.camera_model = "PINHOLE"
        reader.camera_params = ",".join(map(repr, map(float, intrinsics)))
        options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = False
        options.ba_refine_extra_params = options.mapper.abs_pose_refine_extra_params = False
    options.num_threads = 1  # sums over threads would not repeat bit for bit
    mode = pycolmap.CameraMode.SINGLE if shared else pycolmap.CameraMode.PER_IMAGE
    here = pycolmap.Device.cpu
    pycolmap.extract_features(
        database, folder, camera_mode=mode, reader_options=reader, device=here
    )
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    # with more threads the index of descriptors does not repeat
    matching = pycolmap.FeatureMatchingOptions(num_threads=1)
    pycolmap.match_exhaustive(database, matching, verification_options=verification, device=here)
    models = pycolmap.incremental_mapping(database, folder, database.parent, options)
    return max(models.values(), key=lambda model: model.num_reg_images())


def _record(
    case: SurveyCase, way: str, model: pycolmap.Reconstruction, centres_m: dict[str, np.ndarray]
) -> Record:
    error_m = centre_errors_m(model, centres_m)
    return {
        "photos": f"{len(case.names)} {case.choice}",
        "shrink": case.shrink,
        "known": "K" if case.known else "–",
        "way": way,
        "seed": case.seed,
        "registered": len(error_m),
        "centre_m": float(error_m.mean()),
        "centre_max_m": float(error_m.max()),
        "error_px": float(model.compute_mean_reprojection_error()),
        "points": model.num_points3D(),
    }


def ratios(records: list[Record]) -> list[Record]:
    """Divide handbench's errors by those of plain COLMAP with one camera, both averaged over the
    seeds. Returns the median, the geometric mean and the largest ratio of the sets of photographs,
    for each size and for given and unknown intrinsics."""
    rows = pd.DataFrame(records)
    errors_m = rows.pivot_table("centre_m", ["shrink", "known", "photos"], "way")
    plain_m = errors_m[errors_m.columns.intersection(PLAIN)].min(axis=1)
    groups = (errors_m["handbench"] / plain_m).groupby(["shrink", "known"])
    return [
        {
            "shrink": shrink,
            "known": known,
            "sets": len(ratio),
            "median": float(ratio.median()),
            "mean": float(np.exp(np.log(ratio).mean())),
            "largest": float(ratio.max()),
        }
        for (shrink, known), ratio in groups
    ]


def main() -> None:
    """Measure the error of camera positions compared with a survey, for handbench and COLMAP, for
    several numbers, sizes and choices of photographs; write and print the table."""
    options = parser("measure_survey", "cameras against a survey, ours and plain COLMAP's")
    holds = "holds images/, K.txt and cameras/NAME.camera"
    options.add_argument("photos", type=Path, metavar="FOLDER", help=holds)
    options.add_argument("--counts", default="11,8,6,5", help="of photographs (default 11,8,6,5)")
    shrinks = "of their sides (default 1,2: whole and half)"
    options.add_argument("--shrinks", default="1,2", help=shrinks)
    choices = "of first, last, spread, random: which photographs (default first)"
    options.add_argument("--choices", default="first", help=choices)
    seeds = "repeats, each with a seed of its own (default 1)"
    options.add_argument("--seeds", type=int, default=1, help=seeds)
    measured(options, study, "survey")


if __name__ == "__main__":
    main()
