"""The tables of scored maps as a result's: lines of each capture, averaged at the end."""

from collections.abc import Iterable
from typing import NamedTuple

import pandas as pd

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.error_causes import (
    Averages,
    cause_lines,
    reliability_lines,
    surface_causes,
)
from handbench.bench.evaluation.tables import CAUSES, RELIABILITY
from handbench.radar.data.depthmap import DepthMap


class Scored(NamedTuple):
    """A depth map of a capture with its errors against a reference."""

    method: str
    reference: str
    depth: DepthMap
    errors: ErrorMap


def explain(maps: Iterable[Scored]) -> dict[str, pd.DataFrame]:
    """CAUSES and RELIABILITY of maps, each a capture's."""
    causes, reliability = Averages(CAUSES), Averages(RELIABILITY)
    for method, reference, depth, errors in maps:
        about = {"reference": reference, "method": method}
        surface = surface_causes(errors.x_m, errors.y_m, errors.reference_z_m)
        for line in cause_lines(depth, errors, surface):
            causes.add(about | line)
        for line in reliability_lines(depth, errors):
            reliability.add(about | line)
    return {"causes": causes.table(), "reliability": reliability.table()}
