"""Draw the figure of docs/measurements/hands.md: python docs/hands.py OUT.png [EDGE_MM [PANEL_PX]]

It shows the hands of the benchmark `hands` as the radar sees them, each where its person holds it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from letters import SUPERSAMPLED, shade, sheet
from PIL import Image, ImageDraw, ImageFont

from handbench.bench.run.benchmark_file import Source, load_benchmark
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.support.config import load

WIDTH_TO_HEIGHT, HEIGHT_M = 0.62, 0.275


def panel(source: Source, base: Path, edge_m: float, height: int) -> Image.Image:
    """Draw the hand of one capture with its name.
    base: folder to which the benchmark's paths are relative; edge_m: edges of the mesh, metres;
    height: of the picture, pixels."""
    assert source.scene is not None and source.persons is not None
    file = load(SceneFile, base / source.scene, "a scene description").of_person(*source.persons)
    file = file.model_copy(
        update={"target": file.target.model_copy(update={"edge_m": edge_m}), "photos": None}
    )
    width = int(WIDTH_TO_HEIGHT * height)
    picture = shade(
        build(file, base).target_mesh, SUPERSAMPLED * width, SUPERSAMPLED * height, HEIGHT_M
    )
    image = Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8)).resize(
        (width, height), Image.Resampling.BOX
    )
    text = f"{file.name[0]} {source.persons[0]}"
    ImageDraw.Draw(image).text(
        (6, 3), text, fill=(235, 215, 200), font=ImageFont.load_default(height // 14)
    )
    return image


def main(out: Path, edge_mm: float = 1.0, height: int = 240) -> None:
    """Draw all hands of the benchmark in one picture and write it to `out`.
    edge_mm: edges of the meshes, mm; height: of each hand's panel, pixels."""
    bench, base = load_benchmark("hands")
    people = sorted(bench.capture, key=lambda source: source.persons or ())
    panels = [panel(source, base, 1e-3 * edge_mm, height) for source in people]
    sheet(panels).quantize(128, dither=Image.Dither.NONE).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(float, sys.argv[2:3]), *map(int, sys.argv[3:4]))
