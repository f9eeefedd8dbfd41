"""handbench in Python: image, compare and draw captures, depth maps, meshes and results.

    import handbench as hb

    hand = hb.simulate("scene.toml", "capture")  # or hb.load("capture"), of any data set
    depth = hand.reconstruct("3fsk")
    score = depth.evaluate()  # against the capture's own surface, or evaluate("mesh.ply")
    print(score["mae_mm"])
    score.plot("errors.png")

Every function does what the command of its name does (`handbench reconstruct`, …), raises
`HandbenchError` for a known mistake, and takes and returns SI units in the radar's frame
(docs/conventions.md). Importing this package loads only the standard library.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from handbench.bench.results.result_folder import Result
    from handbench.calibration.transforms import Transform
    from handbench.groundtruth.mesh.surface import Surface
    from handbench.interface import (
        Capture,
        Depth,
        RunResult,
        Score,
        calibrate,
        compare,
        load,
        methods,
        reconstruct_mesh,
        run,
        save_capture,
        simulate,
        stream,
    )
    from handbench.radar.data.capture import RadarCapture
    from handbench.radar.data.depthmap import DepthMap
    from handbench.radar.simulation.forward import operator
    from handbench.support.errors import HandbenchError

if not (Path(__file__).parent / "bench").exists():  # in a clone, whose rooms stand beside it
    __path__.append(str(Path(__file__).parents[1]))

__all__ = [
    "Capture",
    "Depth",
    "DepthMap",
    "HandbenchError",
    "RadarCapture",
    "Result",
    "RunResult",
    "Score",
    "Surface",
    "Transform",
    "calibrate",
    "compare",
    "load",
    "methods",
    "operator",
    "reconstruct_mesh",
    "run",
    "save_capture",
    "simulate",
    "stream",
]
DEFINED_IN = {  # the modules of the names that handbench/interface.py does not have
    "Result": "handbench.bench.results.result_folder",
    "operator": "handbench.radar.simulation.forward",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    if name not in __all__:
        raise AttributeError(f"module 'handbench' has no attribute '{name}'")
    return getattr(import_module(DEFINED_IN.get(name, "handbench.interface")), name)


def __dir__() -> list[str]:
    return __all__
