"""Small valid inputs of the readers of pictures and results, each written into an empty folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from handbench.support.store import Stage, cached
from tests.fuzz.geometry_seeds import AXIS_M, SIZE, depth

if TYPE_CHECKING:
    from PIL import Image


def _picture(mode: str = "RGB") -> Image.Image:
    from PIL import Image

    return Image.fromarray(
        np.random.default_rng(1).integers(0, 255, (SIZE[1], SIZE[0], 3), np.uint8)
    ).convert(mode)


def _exif() -> Image.Exif:
    from PIL import Image

    exif = Image.Exif()
    exif[0x0110], exif[0x0112] = "Camera", 6
    exif.get_ifd(0x8769).update(
        {0x920A: 35.0, 0xA405: 50, 0xA20E: 1000.0, 0xA210: 2, 0xA002: SIZE[0]}
    )
    return exif


def pictures(folder: Path) -> None:
    """Photographs in every form, the first with EXIF data."""
    from PIL import Image

    _picture().save(folder / "a.jpg", exif=_exif(), quality=60)
    _picture().save(folder / "b.png")
    Image.fromarray(np.arange(1200, dtype=np.uint16).reshape(30, 40)).save(folder / "c.tif")
    _picture("P").save(folder / "d.png")


def masks(folder: Path) -> None:
    """A mask for each of `photos`, the last of the upright picture."""
    (folder / "masks").mkdir()
    for name in ("a.jpg.png", "b.png", "d.png"):
        picture = _picture("L")
        (picture.rotate(90, expand=True) if name == "d.png" else picture).save(
            folder / "masks" / name
        )


def small_photo(folder: Path) -> None:
    """A photograph to make small."""
    _picture().save(folder / "hand.jpg", exif=_exif(), quality=60)


def result(folder: Path) -> None:
    """A complete result of one method on one capture."""
    from handbench.bench import results
    from handbench.bench.evaluation.tables import CURVES, SCORES, TABLE, TASKS, frame
    from handbench.radar.data.depthmap import DepthMap

    z_m, flat = np.full((5, 5), 0.3), np.zeros((5, 5))
    DepthMap(AXIS_M, AXIS_M, z_m, flat, "2fsk").save(results.depth_path(folder, "F", "2fsk"))
    results.write_surface(folder, "F", "truth", results.SurfaceMap(AXIS_M, AXIS_M, z_m, flat))
    results.write_errors(folder, "F", "2fsk", "truth", results.ErrorMap(AXIS_M, AXIS_M, flat, z_m))
    small_photo(folder)
    results.write_photo(folder, "F", folder / "hand.jpg")
    own = ("F", "2fsk", "truth", "", 0)
    scores = [
        (*own, "mae_mm", 6.0),
        (*own, "complete_2mm_percent", 40.0),
        ("F", "2fsk", "", "", 1, "strongest_z_m", 0.3),
    ]
    results.write_tables(
        folder,
        table=frame(TABLE, [("mae_mm", "2fsk", 6.0, 5.5, 6.5, "mm", 6.6, "truth")]),
        tasks=frame(
            TASKS,
            [
                (
                    "a",
                    "F",
                    "2fsk",
                    "reconstruct",
                    0.1,
                    0.2,
                    300.0,
                    False,
                    0.01,
                    "here",
                    9.0,
                    0.1,
                    1e-6,
                )
            ],
        ),
        scores=frame(SCORES, scores),
        curves=frame(CURVES, [("2fsk", "none", "truth", 10.0, 4.0)]),
    )
    results.write_config(folder, 'name = "small"\n')
    results.write_about(
        folder,
        results.About(
            name="small",
            protocol={"id": "paper", "repeats": 3},
            metrics={
                "mae_mm": results.MetricFacts(
                    title="MAE", unit="mm", better="lower", definition="mean"
                )
            },
            inputs={"F": "0" * 64},
            versions={"numpy": "2"},
            machine={"cores": 2},
            captures=(
                results.CaptureFacts(name="F", pose="F", distance_m=0.3, references=("truth",)),
            ),
            methods=(
                results.MethodFacts(name="2fsk", title="2-FSK", config={"F": {"tolerance": 1e-5}}),
            ),
        ),
    )


def older_result(folder: Path) -> None:
    """The same as version 0.2 wrote it."""
    from handbench.bench import results
    from handbench.bench.evaluation.tables import (
        CAPTURES,
        CAUSES,
        COMPARISONS,
        EQUAL,
        RELIABILITY,
        REPEATS,
        frame,
    )

    result(folder)
    (folder / "scores.csv").unlink()
    compared = (
        "mae_mm",
        "2fsk",
        "3fsk",
        1.0,
        0.5,
        1.5,
        "mm",
        0.01,
        2.0,
        "truth",
        1,
        20,
        "2-FSK is better",
        "none",
    )
    results.write_tables(
        folder,
        repeats=frame(REPEATS, [("F", "2fsk", 0, 0.3)]),
        comparisons=frame(COMPARISONS, [compared]),
        equal=frame(EQUAL, [("mae_mm", "none", "2fsk", 6.0, 5.5, 6.5, "mm", "truth")]),
        captures=frame(CAPTURES, [("mae_mm", "none", "2fsk", "F", 6.0, "mm", "truth")]),
        causes=frame(
            CAUSES, [("truth", "2fsk", "part", "palm", None, None, 0.1, 0.2, 3.0, 9.0, 20, 1)]
        ),
        reliability=frame(RELIABILITY, [("truth", "2fsk", "all", True, 95.0, 94.0, 2.5, 20, 1)]),
    )


def tradeoff(folder: Path) -> None:
    """A trade-off of one setting."""
    from handbench.bench import results

    section = results.Section(
        name="imaging",
        title="Imaging",
        metric="mae_mm",
        unit="mm",
        definition="mean",
        seconds="all",
        reference="one",
    )
    facts = results.TradeoffFacts(
        name="small",
        scored_against="truth",
        sections=(section,),
        captures=("F",),
        claims=(results.Claim(text="faster", paper=1000.0),),
    )
    figures = dict.fromkeys(
        (
            "error",
            "low",
            "high",
            "seconds",
            "seconds_low",
            "seconds_high",
            "ratio",
            "acquisition_s",
            "plan_s",
            "imaging_s",
            "extraction_s",
            "operations",
            "peak_memory_mb",
        ),
        1.5,
    )
    results.write_tradeoff(
        folder,
        facts,
        [
            results.Setting(
                section="imaging",
                name="one",
                title="One",
                knobs=json.dumps({"tolerance": 1e-3}),
                metric="mae_mm",
                unit="mm",
                on_front=True,
                dominated_by="",
                **figures,
            )
        ],
    )


def kept_stage() -> Stage:
    """The stage whose content is a depth map."""
    return Stage("stage", depth, {}, [])


def kept(folder: Path) -> None:
    """A kept stage, and what it made once more beside it."""
    one = kept_stage()
    cached(folder, one)
    one.folder(folder).rename(folder / "stage")  # whatever its key is
    (folder / "fresh.npz").write_bytes((folder / "stage" / "depth.npz").read_bytes())
