"""Ground truth: photographs to a metric mesh, and the mesh's depth on the radar's grid."""

import sys
from types import ModuleType
from typing import Any


class _GroundTruth(ModuleType):
    """The package, callable for compatibility: `handbench.groundtruth(photos)` was a function in
    version 0.2."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        return sys.modules["handbench"].reconstruct_mesh(*args, **options)


sys.modules[__name__].__class__ = _GroundTruth
