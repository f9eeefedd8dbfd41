"""The command line: handbench COMMAND. Large libraries are imported only after a command is
chosen."""

import argparse
import io
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from importlib import import_module
from importlib.metadata import version
from typing import Any, NoReturn

from handbench.cli.options import COMMANDS, add_options
from handbench.support.errors import HandbenchError
from handbench.support.progress import say


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command of the command line, and return the exit code.
    A known error prints one line on stderr and gives 2 (1: after a result of which stages failed);
    an unknown one keeps its traceback. SIGINT (Ctrl-C), SIGTERM and SIGHUP end a command by an
    exception, which removes its temporary files: one line, and 128 and the signal's number, also
    where a library turns this exception into another.
    arguments: the words after "handbench"; None: those with which this process was started."""
    code, message = 2, ""
    ended: list[int] = []  # by these signals

    def end(number: int, _: object) -> None:
        ended.append(number)
        raise KeyboardInterrupt(number)

    try:
        _prepare(end)
        _run(arguments)
        code = 0
    except BrokenPipeError:
        code = 141  # the reader went away; so do we
    except HandbenchError as error:
        message, code = str(error), error.code
    except MemoryError as error:
        message = (
            f"out of memory ({error}); close other programs, or use fewer pixels, tones or frames"
        )
    except BaseException as error:
        if isinstance(error, OSError) and error.errno:  # no library's own
            message = (
                f"{error.filename or 'output or temporary files'}: {error.strerror}; check its "
                "permissions, free space on the disk, choose another place (for temporary files "
                "set TMPDIR), or check that the disk is still connected"
            )
        elif not ended:
            raise
    finally:
        _drain()
    if ended:
        code = 128 + ended[0]
        message = "interrupted; no file is half-written; `run` and `groundtruth` resume"
    if message:
        say(f"handbench: {message}")
    return code


def _run(arguments: Sequence[str] | None) -> None:
    known = parser()
    if "_ARGCOMPLETE" in os.environ:  # a shell asks what could come next
        import argcomplete

        argcomplete.autocomplete(known)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # what a terminal's encoding lacks is "?"
    options = known.parse_args(arguments)
    try:
        os.getcwd()
    except FileNotFoundError:
        raise HandbenchError("the current folder has been deleted; go to another") from None
    with ExitStack() as device:
        if "device" in options:
            from handbench.radar.imaging.device import use_device

            device.enter_context(use_device(options.device))
        module, function = options.function.split(".")
        getattr(import_module(f"handbench.cli.{module}"), function)(options)
    sys.stdout.flush()


def _prepare(end: Any) -> None:
    """Have streams that are closed be the null device, so that no file gets their numbers; have
    signals that end a command call `end`, again if Python ignored what this raised, as it does in
    callbacks; and draw pictures without windows and dates, whatever the variables of these say."""
    os.environ["MPLBACKEND"] = "agg"
    os.environ.pop("SOURCE_DATE_EPOCH", None)
    for name, mode in {"stdin": "r", "stdout": "w", "stderr": "w"}.items():  # 0, 1, 2
        if getattr(sys, name) is None:
            stream = open(os.devnull, mode)  # noqa: SIM115  which stays open
            os.set_inheritable(stream.fileno(), True)
            setattr(sys, name, stream)
    sys.unraisablehook = _ignored
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGALRM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup has SIGHUP
            with suppress(ValueError):  # outside the main thread
                signal.signal(number, end)


def _ignored(what: Any) -> None:
    if what.exc_type is KeyboardInterrupt:
        signal.alarm(1)
    else:
        sys.__unraisablehook__(what)


def _drain() -> None:
    """Discard output that could not be written, so that Python does not try again at exit."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, as all others."""

    def error(self, message: str) -> NoReturn:
        raise HandbenchError(f"{message}; see {self.prog} --help")


def parser() -> Parser:
    """Return the parser of the command line, with the commands and options declared in
    commands.toml."""
    top = Parser(
        prog="handbench",
        description="How well near-field radar sees a human hand, and what that accuracy costs in "
        "time.",
    )
    top.add_argument("--version", action="version", version=f"%(prog)s {version('handbench')}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, entry in COMMANDS.items():
        command = commands.add_parser(name, help=entry["help"], description=entry["help"])
        add_options(command, entry["options"])
        command.set_defaults(function=entry["function"])
    return top
