"""The command line: handbench COMMAND. Nothing heavy is imported before a command is chosen."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext

from bench.cli import (
    calibrate,
    compare,
    doctor,
    draw,
    evaluate,
    export,
    groundtruth,
    import_,
    list,
    reconstruct,
    report,
    run,
    simulate,
    stability,
    study,
    tradeoff,
    validate,
)
from radar.support.errors import HandbenchError

COMMANDS = (
    *(run, simulate, groundtruth, calibrate, reconstruct, evaluate, draw, report, tradeoff, compare, stability, study),
    *(import_, export, list, validate, doctor),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; a known error is one line on stderr and exit code 2, an unknown one keeps its traceback."""
    options = parser().parse_args(arguments)
    try:
        with _device(options):
            options.module.run(options)
    except HandbenchError as error:
        print(f"handbench: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("handbench: interrupted; nothing was left half-written, and `run` resumes", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader went away; so do we
        return 141
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES):
            raise
        where = error.filename or os.environ.get("TMPDIR", "/tmp")
        print(f"handbench: {where}: {error.strerror}; free the space or choose another place", file=sys.stderr)
        return 2
    return 0


def _device(options: argparse.Namespace) -> AbstractContextManager[None]:
    """The device that the command images on, if it images."""
    if "device" not in options:
        return nullcontext()
    from radar.imaging.device import use_device

    return use_device(options.device)


def parser() -> argparse.ArgumentParser:
    """All commands and their options."""
    purpose = "How well near-field radar sees a human hand, and what that accuracy costs in time."
    top = argparse.ArgumentParser(prog="handbench", description=purpose)
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in COMMANDS:
        name = command.__name__.rpartition(".")[2].rstrip("_")
        told = commands.add_parser(name, help=command.HELP, description=command.HELP)
        command.add_arguments(told)
        told.set_defaults(module=command)
    return top


if __name__ == "__main__":
    sys.exit(main())
