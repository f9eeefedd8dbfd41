"""`handbench list`: print methods with their defaults and sources, metrics, benchmarks, effects,
data sets and poses."""

import argparse
import json
from collections.abc import Iterator

from handbench.support.errors import HandbenchError

SECTIONS = {  # as commands.toml names them → title
    "methods": "methods",
    "plugins": "plug-ins",
    "metrics": "metrics",
    "benchmarks": "embedded benchmarks",
    "effects": "effects of simulated echoes",
    "datasets": "data sets",
    "poses": "poses",
}


def run(options: argparse.Namespace) -> None:
    """Print all methods, metrics, benchmarks, effects, data sets and poses, or one of these
    sections.
    With a filter, only entries are printed whose name or first line contains this text."""
    wanted = (options.filter or "").casefold()
    printed = False
    for section in [options.section] if options.section else SECTIONS:
        found = [entry for entry in _entries(section) if wanted in entry[0].casefold()]
        printed = printed or bool(found)
        if found:
            print(SECTIONS[section], *(f"  {line}" for entry in found for line in entry), sep="\n")
    if wanted and not printed:
        raise HandbenchError(
            f"list: no name and no description contains '{options.filter}'; use another word, or "
            "`handbench list` for all"
        )


def _entries(section: str) -> Iterator[list[str]]:
    """Yield the entries of one section of `handbench list`, each as a list of the lines to print.
    section: a key of SECTIONS."""
    from handbench.bench.benchmarks.benchmark_file import embedded_benchmarks
    from handbench.bench.datasets.dataset import FOREIGN, IMPORTERS, KNOWN
    from handbench.bench.evaluation.metrics import definitions
    from handbench.bench.scenes.hand_pose import POSES
    from handbench.radar.methods.registry import BROKEN, methods, with_version
    from handbench.radar.simulation.known_effects import DECLARED

    known = methods()  # which loads the plug-ins, too
    plugged = [method for method in known if method.distribution is not None]
    if section in ("methods", "plugins"):
        for method in known if section == "methods" else plugged:
            about = [f"source: {method.source}"]
            if method.distribution is not None:
                about.append(f"plug-in: {with_version(method.distribution)}")
            defaults = method.config().model_dump(mode="json") if section == "methods" else {}
            about += [f"{key} = {json.dumps(value)}" for key, value in defaults.items()]
            yield [f"{method.id:<18} {method.summary}", *(f"{'':<18} {line}" for line in about)]
        if section == "plugins":
            yield from ([f"{name}: {reason} (not loaded)"] for name, reason in BROKEN.items())
            if not (plugged or BROKEN):
                yield ["none is installed"]
    elif section == "effects":
        for name, facts in DECLARED.items():
            yield [f"{name:<18} {facts['does']}", f"{'':<18} source: {facts['source']}"]
    else:
        imported = ", ".join((*FOREIGN, *IMPORTERS))
        lines = {
            "metrics": [f"{key:<28} {definition}" for key, definition in definitions().items()],
            "benchmarks": embedded_benchmarks(),
            "datasets": [
                f"read from their own folders: {KNOWN}",
                f"by `handbench import`: {imported}",
            ],
            "poses": [", ".join(POSES)],
        }
        yield from ([line] for line in lines[section])
