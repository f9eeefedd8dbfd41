"""Axes and numbers that no machine holds are refused as they are read."""

import pytest

from handbench.radar.methods.fsk_config import FskConfig
from handbench.radar.methods.projection_config import BroadbandConfig
from handbench.support.config import parse
from handbench.support.errors import HandbenchError


def axis(step_m: float, stop_m: float = 1.0, start_m: float = 0.0) -> dict[str, float]:
    return {"start_m": start_m, "stop_m": stop_m, "step_m": step_m}


@pytest.mark.parametrize(
    ("model", "values", "words"),
    [
        (FskConfig, {"x": axis(1e-9)}, "step_m = 1e-09 makes 1e+09 samples"),
        (FskConfig, {"x": axis(5e-324)}, "step_m is 4.941e-324; expected 0 or a size from 1e-30"),
        (FskConfig, {"x": axis(1.0, start_m=-1e300)}, "'x.start_m' is -1e+300"),
        (FskConfig, {"x": axis(2e-4), "y": axis(2e-4)}, "axes x, y make 25010001 points"),
        (BroadbandConfig, {"x": axis(1e-3), "y": axis(1e-3), "z": axis(2e-3)}, "axes x, y, z make"),
        (BroadbandConfig, {"start_hz": 1e300}, "'start_hz' is 1e+300"),
        (BroadbandConfig, {"count": 10**9}, "'count' is 1000000000"),
    ],
)
def test_what_no_machine_holds_is_refused(model, values, words):
    with pytest.raises(HandbenchError) as refused:
        parse(model, values, "x.toml")
    assert words in str(refused.value) and str(refused.value).startswith("x.toml: ")
