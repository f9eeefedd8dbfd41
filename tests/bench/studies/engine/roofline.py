"""The roofline: what the projection's parts reach of what a core can, by the rate of a matrix
product and of a copy.

One core, CPU seconds, at a tolerance of 1e-3. Operations are counted from the plan: 8 for a complex
product and its sum, PHASE for a sine with its cosine; bytes are what a part reads and writes once.
"""

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from handbench.radar.imaging.api import GridImager
from handbench.radar.imaging.cpu.executor import _down
from handbench.radar.imaging.cpu.forward import gather
from handbench.radar.imaging.cpu.forward import planes as real_planes
from handbench.radar.imaging.plan import GridPlan
from handbench.radar.imaging.tree import Family, Node
from handbench.support.cost import gemm
from handbench.support.parallel import one_blas_thread
from tests.bench.studies.columns import Record
from tests.bench.studies.engine.scope import Inputs

TOLERANCE = 1e-3
PHASE = 30  # 12 fused steps of two series, and the reduction of the argument
COPIED = 1 << 25  # floats, beyond every cache
REPEATS = 5


def roofline_rows(inputs: Inputs) -> list[Record]:
    """A record for each part of a projection: its operations, bytes, rate, and that over its
    roof."""
    plan = GridPlan(inputs.tones_hz, inputs.array, inputs.grid, Family(TOLERANCE, False))
    imager = GridImager(plan, inputs.tones_hz, inputs.array, False)
    tree, executor, samples = plan.tree, imager._executor, inputs.samples["hand"]
    assert tree is not None and executor is not None
    nodes, images = imager.nodes(samples, inputs.grid.z_m)
    where, source, target = plan.sort(tree, nodes), *np.ones((2, COPIED), np.float32)
    with one_blas_thread():
        root = _down(real_planes(samples), tree.root_node, tree.top_node)
        cells = [executor._cell(cell, where) for cell in tree.touched(where)]
        below = [_down(root, tree.top_node, node) for node, _, _ in cells]

        def leaves() -> None:
            for part, (node, leaves, starts) in zip(below, cells, strict=True):
                place = tree.passes, tree.reference_m, where.points_m, starts
                gather(part, node.turns_per_m, leaves, *place, 1)

        def into_cells() -> None:
            for node, _, _ in cells:
                _down(root, tree.top_node, node)

        work = {
            "cells": (into_cells, *_of_cells(tree.top_node, [node for node, _, _ in cells])),
            "leaves": (leaves, *_of_leaves(cells)),
            "resampling": (partial(imager.upsampler.project, nodes, images), *_of_resampling(plan)),
        }
        gemm_s, copy_s, *seconds = _in_turns(
            [
                partial(gemm, inputs.scope.gemm_size),
                partial(np.copyto, target, source),
                *(call for call, _, _ in work.values()),
            ]
        )
    rates = 2e-9 * inputs.scope.gemm_size**3 / gemm_s, 8e-9 * COPIED / copy_s
    each = zip(work.items(), seconds, strict=True)
    return [_row(name, took, flops, size, *rates) for (name, (_, flops, size)), took in each]


def _row(
    part: str, seconds: float, flops: float, size: float, gemm_gflops: float, copy_gbs: float
) -> Record:
    roof = min(gemm_gflops, copy_gbs * flops / size)
    return {
        "section": "roofline",
        "part": part,
        "seconds": seconds,
        "gflop": 1e-9 * flops,
        "intensity": flops / size,
        "rate": 1e-9 * flops / seconds,
        "roof": roof,
        "share": 1e-9 * flops / seconds / roof,
        "gemm_rate": gemm_gflops,
        "copy_rate": copy_gbs,
    }


def _in_turns(calls: list[Callable[[], object]]) -> np.ndarray:
    """Median of the CPU seconds of each call; in turns, since a machine that others share changes
    its speed."""
    took = np.zeros((1 + REPEATS, len(calls)))
    for repeat in took:
        for i, call in enumerate(calls):
            start = time.process_time()
            call()
            repeat[i] = time.process_time() - start
    return np.median(took[1:], axis=0)


def _sizes(node: Node) -> tuple[int, ...]:
    return len(node.turns_per_m), *(len(leg.length_m) for leg in node.legs)


def _descent(parent: tuple[int, ...], child: tuple[int, ...]) -> float:
    """Operations from a parent's samples to a child's: the phases' products, and three of real
    weights."""
    k, a, b = parent
    fewer, n, m = child
    return 6.0 * k * a * b + 4.0 * fewer * (k * a * b + a * b * m + a * n * m)


def _of_cells(root: Node, cells: list[Node]) -> tuple[float, float]:
    flops = sum(_descent(_sizes(root), _sizes(cell)) for cell in cells)
    return flops, 8.0 * sum(np.prod(_sizes(root)) + np.prod(_sizes(cell)) for cell in cells)


def _of_leaves(cells: list) -> tuple[float, float]:
    flops = size = 0.0
    for node, leaves, starts in cells:
        for (k, a, b), points in zip(leaves.sizes[:, :3], np.diff(starts), strict=True):
            flops += _descent(_sizes(node), (k, a, b)) + k * points * (
                8 * (a * b + a) + PHASE * (a + b)
            )
            size += 8 * np.prod(_sizes(node)) + 32 * points
    return flops, size


def _of_resampling(plan: GridPlan) -> tuple[float, float]:
    nz, ny, nx = plan.nodes.shape
    lines = 2 * nz * ny, 2 * nz * len(plan.grid.x_m), 2 * len(plan.grid.x_m) * len(plan.grid.y_m)
    axes = plan.x, plan.y, plan.z
    products = sum(
        2.0 * line * sum(w.size for *_, w in axis.windows)
        for line, axis in zip(lines, axes, strict=True)
    )
    voxels = float(np.prod(plan.grid.shape))
    return products + 3 * voxels + PHASE * nz * ny * nx, 8.0 * (
        nz * ny * nx + 2 * nz * ny * len(plan.grid.x_m)
    )
