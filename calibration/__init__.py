"""Calibration: transforms between named frames, target detection, registration.

`groundtruth` stands on this package alone, so the foundation (errors, strict configuration, atomic files,
progress) reaches it through here.
"""

from radar.config import Config, load, parse, read_toml, suggest
from radar.errors import HandbenchError
from radar.files import (
    atomic_folder,
    atomic_path,
    content_hash,
    inside,
    read_json,
    read_npz,
    require_file,
    require_folder,
    write_json,
    write_npz,
    write_text,
)
from radar.kept import keep, key_of
from radar.memory import require_free
from radar.parallel import one_blas_thread
from radar.progress import say, track

__all__ = [
    "Config",
    "HandbenchError",
    "atomic_folder",
    "atomic_path",
    "content_hash",
    "inside",
    "keep",
    "key_of",
    "load",
    "one_blas_thread",
    "parse",
    "read_json",
    "read_npz",
    "read_toml",
    "require_file",
    "require_folder",
    "require_free",
    "say",
    "suggest",
    "track",
    "write_json",
    "write_npz",
    "write_text",
]
