"""`handbench list`: methods with their defaults and sources, metrics, benchmarks, effects, poses."""

import argparse
import json

from bench.evaluation.metrics import definitions
from bench.run.benchmark_file import embedded
from bench.scenes.hand_pose import POSES
from radar.methods import registry
from radar.methods.registry import methods
from radar.simulation.selection import EFFECTS
from radar.support.closure import with_version


def run(options: argparse.Namespace) -> None:
    """Print everything that has a name."""
    print("methods")
    for method in methods():
        print(f"  {method.id:<18} {method.summary}")
        print(f"  {'':<18} source: {method.source}")
        if method.distribution is not None:
            print(f"  {'':<18} plug-in: {with_version(method.distribution)}")
        for key, value in method.config().model_dump(mode="json").items():
            print(f"  {'':<18} {key} = {json.dumps(value)}")
    if registry.BROKEN:
        print("plug-ins that could not be loaded")
    for name, reason in registry.BROKEN.items():
        print(f"  {name}: {reason}")
    print("metrics")
    for key, definition in definitions().items():
        print(f"  {key:<28} {definition}")
    print("embedded benchmarks")
    for name in embedded():
        print(f"  {name}")
    print("effects of simulated echoes")
    for effect in EFFECTS:
        print(f"  {effect.id:<18} {effect.does}")
        print(f"  {'':<18} source: {effect.source}")
    print(f"poses\n  {', '.join(POSES)}")
