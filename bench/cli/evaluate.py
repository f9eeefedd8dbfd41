"""`handbench evaluate`: how far a depth map is from a mesh."""

import argparse
import json


def run(options: argparse.Namespace) -> None:
    """Depth map × mesh → metrics on stdout."""
    from bench.datasets.maroon_alignment import load_any_transform
    from bench.evaluation.metrics import definitions
    from bench.run.scoring import score_map
    from bench.validation import surface_fit
    from groundtruth.mesh.surface import read_surface
    from radar.data.depthmap import load_depthmap
    from radar.support.progress import say

    depth = load_depthmap(options.depth)
    if options.most_p_gross is not None:
        depth = depth.trusted(options.most_p_gross)
    transform, surface = load_any_transform(options.transform), read_surface(options.mesh)
    _, values = score_map(depth, surface, transform)
    about = {"method": depth.method, "definitions": definitions(list(values))}
    if transform.refined:
        about["refined"] = f"{options.transform}: {transform.refined['reason']}"
    if doubts := surface_fit.findings(depth, surface.moved(transform)):
        about["doubts"] = doubts
    print(json.dumps({**values, **about}, indent=2))
    for doubt in doubts:
        say(f"{options.depth}: {doubt}")
