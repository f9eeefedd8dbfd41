"""`handbench evaluate`: how far a depth map is from a mesh."""

import argparse
import json


def run(options: argparse.Namespace) -> None:
    """Depth map × mesh → metrics on stdout."""
    from bench.datasets.maroon_alignment import load_any_transform
    from bench.evaluation.depth_errors import error_map
    from bench.evaluation.floor import floor_mm
    from bench.evaluation.metrics import definitions, pool
    from bench.run.scoring import reference_depth
    from calibration.transforms import identity
    from radar.data.depthmap import load_depthmap
    from radar.data.grid import PixelGrid

    depth = load_depthmap(options.depth)
    if options.most_p_gross is not None:
        depth = depth.trusted(options.most_p_gross)
    transform = load_any_transform(options.transform) if options.transform else identity("radar")
    reference = reference_depth(options.mesh, transform, PixelGrid(depth.x_m, depth.y_m))
    errors = error_map(depth.x_m, depth.y_m, depth.z_m, reference.z_m, reference.sigma_m, reference.met)
    values = pool([errors]) | {"floor_mm": floor_mm([errors], [reference])}
    about = {"method": depth.method, "definitions": definitions(list(values))}
    if transform.refined:
        about["refined"] = f"{options.transform}: {transform.refined['reason']}"
    print(json.dumps({**values, **about}, indent=2))
