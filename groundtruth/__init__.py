"""Ground truth: reconstruct a metric mesh from photographs, and compute its depth on the radar's
pixel grid."""

import sys
from types import ModuleType
from typing import Any


class _GroundTruth(ModuleType):
    """The package `groundtruth` as a module that can also be called.

    In version 0.2, `handbench.groundtruth(photos)` was a function that reconstructs a mesh; a call
    of the module still does that.
    """

    def __call__(self, *args: Any, **options: Any) -> Any:
        return sys.modules["handbench"].reconstruct_mesh(*args, **options)


sys.modules[__name__].__class__ = _GroundTruth
