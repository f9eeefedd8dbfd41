"""`handbench study NAME`: the studies of bench/studies/studies.toml, their options, and how one is run."""

import argparse
from importlib import import_module
from pathlib import Path
from typing import Any

from handbench.bench import studies
from handbench.cli.options import add_options, declared
from handbench.support.errors import HandbenchError

STUDIES = Path(studies.__file__).with_name("studies.toml")


def add_studies(command: argparse.ArgumentParser) -> None:
    """Add a parser for each study."""
    commands = command.add_subparsers(dest="study", metavar="NAME")
    for name, entry in declared(STUDIES).items():
        parser = commands.add_parser(name, help=entry["text"], description=entry["text"])
        add_options(parser, entry["options"])
        out = f"folder, or FILE.json beside which the page stands (default runs/{name})"
        parser.add_argument("-o", "--out", type=Path, metavar="DIR", help=out)
        parser.add_argument("--only", default="", metavar="TEXT", help="the cases whose name holds TEXT")


def run(options: argparse.Namespace) -> None:
    """Measure, print the tables, write the files; a case that fails ends with exit code 2."""
    if options.list or options.study is None:
        print("\n".join(f"{name:<16}{entry['text']}" for name, entry in declared(STUDIES).items()))
        return
    from handbench.bench.studies import study

    entry = declared(STUDIES)[options.study]
    given = {_key(option): getattr(options, _key(option)) for option in entry["options"]}
    out = options.out or Path("runs") / options.study
    work = (out.parent if out.suffix == ".json" else out) / "work"
    chosen = import_module(f"handbench.bench.studies.{entry['module']}").study(work=work, **given)
    found = study.run(chosen, out, _command(options.study, entry["options"], given), options.only)
    print(found.markdown())
    print(f"study: {out}")
    if found.failures:
        raise HandbenchError(f"study {options.study}: {len(found.failures)} of {len(chosen.cases)} cases failed")


def _key(option: str) -> str:
    return option.lstrip("-").replace("-", "_")


def _command(name: str, known: dict[str, dict[str, Any]], given: dict[str, Any]) -> str:
    """The command that does this again."""
    words = ["handbench study", name]
    for option, settings in known.items():
        value = given[_key(option)]
        if value in (settings.get("default"), False):
            continue
        words.append(option if value is True else f"{option} {value}")
    return " ".join(words)
