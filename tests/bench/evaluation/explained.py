"""The tables of scored maps as a run makes them: lines by the stage that scores a capture, averaged at the end."""

from collections.abc import Iterable

import pandas as pd

from handbench.bench.evaluation.error_causes import Scored, averaged_lines, lines_of, surface_causes
from handbench.bench.results.tables import CAUSES, RELIABILITY


def explain(maps: Iterable[Scored]) -> dict[str, pd.DataFrame]:
    """CAUSES and RELIABILITY of maps, each a capture's."""
    of = [lines_of(m, surface_causes(m.errors.x_m, m.errors.y_m, m.errors.reference_z_m)) for m in maps]
    schemas = {"causes": CAUSES, "reliability": RELIABILITY}
    return {name: averaged_lines((x for lines in of for x in lines[name]), schema) for name, schema in schemas.items()}
