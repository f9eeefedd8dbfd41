# PYTHON_ARGCOMPLETE_OK
"""The command line: handbench COMMAND. Large libraries are imported only after a command is
chosen."""

import argparse
import errno
import io
import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from importlib.metadata import version

from handbench.cli.options import COMMANDS, add_options
from handbench.support.errors import HandbenchError

DISK = {  # errors of a disk that is full, write-protected or gone
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EROFS,
    errno.EACCES,
    errno.ENOENT,
    errno.ENOTDIR,
    errno.ESTALE,
    errno.EIO,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command of the command line, and return the exit code.
    A known error prints one line on stderr and gives 2; an unknown one keeps its traceback.
    arguments: the words after "handbench"; None: those with which this process was started."""
    known = parser()
    if "_ARGCOMPLETE" in os.environ:  # a shell asks what could come next
        import argcomplete

        argcomplete.autocomplete(known)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # what a terminal's encoding lacks is "?"
    options = known.parse_args(arguments)
    code = 2
    try:
        with _device(options):
            import_module(f"handbench.cli.{options.module}").run(options)
        sys.stdout.flush()
        return 0
    except BrokenPipeError:
        _drain()  # the reader went away; so do we
        return 141
    except HandbenchError as error:
        message = str(error)
    except KeyboardInterrupt:
        code = 130
        message = "interrupted; no file is half-written, and the same `run` command resumes the run"
    except MemoryError as error:
        message = (
            f"out of memory ({error}); close other programs, or use fewer pixels, tones or frames"
        )
    except OSError as error:
        if error.errno not in DISK:
            raise
        _drain()
        message = (
            f"{error.filename or 'output or temporary files'}: {error.strerror}; free space on the "
            "disk, choose another place (for temporary files set TMPDIR), or check that the disk "
            "is still connected"
        )
    print(f"handbench: {message}", file=sys.stderr)
    return code


def _drain() -> None:
    """Discard the output that stdout could not write, so that Python does not try to write it again
    at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _device(options: argparse.Namespace) -> AbstractContextManager[None]:
    """Return a context manager that makes the command image on the device in its options (CPU or
    GPU). It has no effect for a command without this option."""
    if "device" not in options:
        return nullcontext()
    from handbench.radar.imaging.device import use_device

    return use_device(options.device)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line, with the commands and options declared in
    commands.toml."""
    purpose = "How well near-field radar sees a human hand, and what that accuracy costs in time."
    top = argparse.ArgumentParser(prog="handbench", description=purpose)
    top.add_argument("--version", action="version", version=f"%(prog)s {version('handbench')}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, entry in COMMANDS.items():
        command = commands.add_parser(name, help=entry["help"], description=entry["help"])
        add_options(command, entry["options"])
        command.set_defaults(module=entry.get("module", name))
    return top


if __name__ == "__main__":
    sys.exit(main())
