"""A worker's part: it finds the folder of a stage ready, or makes it, and answers with a small record."""

import threading
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from handbench.bench.datasets.checksums import require_unchanged
from handbench.bench.datasets.dataset import open_capture
from handbench.radar.methods.registry import method_key
from handbench.support.errors import HandbenchError
from handbench.support.store import Stage, Stamp, code_hash, kept

HASH = "hash"  # no stage that is kept: a capture's folder has to be read to know what it holds
_ALONE = threading.Lock()  # a cost is measured of the whole process, which therefore does one stage at a time


@dataclass(frozen=True)
class Done:
    """The outcome of a stage. stamp: None where no folder was made; failure: the error that the user can mend, if
    any."""

    stamp: Stamp | None = None
    cached: bool = False
    key: str = ""
    failure: str | None = None


def perform(root: Path, stage: Stage) -> Done:
    """Carry out a stage, or find its folder under `root` ready; a HandbenchError becomes the record's `failure`."""
    try:
        with _ALONE:
            return _perform(root, stage)
    except HandbenchError as error:
        return Done(failure=str(error))


def _perform(root: Path, stage: Stage) -> Done:
    if stage.name == HASH:
        key = open_capture(stage.arguments["folder"]).key(stage.arguments["frames"])
        require_unchanged(Path(stage.arguments["folder"]))
        return Done(key=key)
    if not root.is_dir():
        raise HandbenchError(f"{root}: is not there on this machine; expected the result folder, shared by all workers")
    if _code_here(stage.maker, stage.method) != stage.code:
        raise HandbenchError(
            f"{stage.label}: this worker's handbench or libraries differ from the client's; install the same on both"
        )
    return Done(*kept(root, stage), stage.key)


@cache
def _code_here(maker: str, method_id: str) -> str:
    return code_hash(maker, method_key(method_id))
