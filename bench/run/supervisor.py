"""Script that runs a foreign program, which is not part of handbench, and supervises it:
python -IS supervisor.py PARENT FOLDER LIMIT_BYTES COMMAND…

It ends when handbench ends, for whatever reason. It kills all processes that the program started,
also those that left its process group. Of the program's output it writes only the last bytes to
stdout. It imports only the standard library.
"""

import ctypes
import os
import resource
import select
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from typing import Any

LAST_BYTES = 4096  # of the output
POLL_S, END_S = 0.05, 5.0  # END_S: for killed processes to end; those of another user do not
PDEATHSIG, CHILD_SUBREAPER = 1, 36  # of prctl


def supervise(parent: int, folder: str, limit_bytes: int, command: list[str]) -> int:
    """Run a command until it ends, and return its exit code (128 + n if signal n ended it).
    parent: process id of handbench; if that process is gone, or ends this one, all processes are
    killed and `folder` is deleted. limit_bytes: limit of the command's address space, and of each
    file that it writes; 0: no limit."""

    def give_up(*_: Any) -> None:
        end_children()
        # not only if handbench has gone: other threads of a killed process may still be ending
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(128 + signal.SIGTERM)

    def begin() -> None:
        libc.prctl(PDEATHSIG, signal.SIGKILL)
        for kind in limited:
            hard = resource.getrlimit(kind)[1]
            least = limit_bytes if hard < 0 else min(limit_bytes, hard)
            resource.setrlimit(kind, (least, least))

    limited = (resource.RLIMIT_AS, resource.RLIMIT_FSIZE) if limit_bytes else ()
    signal.signal(signal.SIGTERM, give_up)
    libc = ctypes.CDLL(None)
    libc.prctl(CHILD_SUBREAPER, 1)  # processes whose parent ends become its children
    libc.prctl(PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        give_up()
    output, inlet = os.pipe()
    os.set_blocking(output, False)
    program = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=inlet,
        stderr=inlet,
        preexec_fn=begin,
        start_new_session=True,  # a signal to its own group does not end this process
    )
    os.close(inlet)
    last = b""
    while program.poll() is None:
        last = read_last(output, last, POLL_S)
    end_children()
    sys.stdout.buffer.write(read_last(output, last, 0.0))
    return program.returncode if program.returncode >= 0 else 128 - program.returncode


def read_last(output: int, last: bytes, wait_s: float) -> bytes:
    """Read what a pipe has, waiting at most wait_s seconds for it; return the last 4096 bytes
    (LAST_BYTES) of all output so far.
    output: file descriptor of the pipe; last: the end of what was read before."""
    if not select.select([output], [], [], wait_s)[0]:
        return last
    with suppress(BlockingIOError):
        while part := os.read(output, 2**16):
            last = (last + part)[-LAST_BYTES:]
            if wait_s:  # the program may write without end
                break
        else:
            time.sleep(wait_s)  # its end is closed
    return last


def end_children() -> None:
    """Kill all descendants of this process, repeating until none is left or 5 s (END_S) have
    passed."""
    end_s = time.monotonic() + END_S
    while time.monotonic() < end_s:
        for child in children():
            with suppress(OSError):
                os.kill(child, signal.SIGKILL)
        try:
            if os.waitpid(-1, os.WNOHANG)[0] == 0:
                time.sleep(0.01)
        except ChildProcessError:
            return


def children() -> list[int]:
    """Return the ids of the processes whose parent is this one."""
    found = []
    for name in filter(str.isdigit, os.listdir("/proc")):
        with suppress(OSError), open(f"/proc/{name}/stat", encoding="utf-8", errors="replace") as f:
            if int(f.read().rpartition(")")[2].split()[1]) == os.getpid():
                found.append(int(name))
    return found


if __name__ == "__main__":
    sys.exit(supervise(int(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4:]))
