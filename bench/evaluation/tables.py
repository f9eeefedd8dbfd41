"""Tables as pandas DataFrames, with declared columns, and their reading and writing as CSV.

An unknown figure is NaN in a DataFrame and an empty cell in a file. Text is never missing, but may
be empty. Columns of type bool are 1 or 0 in a file.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from handbench.support.errors import HandbenchError
from handbench.support.files import MOST_CELLS, RESULT_BYTES, atomic_path, read_text

if TYPE_CHECKING:
    import pandas as pd

LEVEL = 0.95  # of every confidence interval
Schema = dict[str, type]  # column → type of its values, in the order of the file
EXPECTED = {float: "a finite number or nothing", int: "a whole number", bool: "0 or 1"}

TABLE: Schema = {  # table.csv: one figure a line
    "metric": str,  # id of the metric
    "method": str,  # id of the method
    "value": float,  # the figure, in `unit`
    "low": float,  # lower end of its 95 % interval
    "high": float,  # upper end
    "unit": str,  # the metric's unit
    "paper": float,  # the paper's figure
    "reference": str,  # what it was scored against: photogrammetry, completed or truth
}
TASKS: Schema = {  # tasks.csv: one stage of one capture a line
    "task": str,  # name of the task
    "capture": str,  # the capture
    "method": str,  # id of the method; empty for a stage of no method
    "stage": str,  # the stage
    "seconds": float,  # wall-clock time
    "cpu_seconds": float,  # time of all cores
    "peak_memory_mb": float,  # largest memory
    "cached": bool,  # the time is an earlier run's
    "plan_seconds": float,  # what the first image of a geometry took longer
    "host": str,  # the machine that did it
    "gemm_gflops": float,  # that machine's rate of float32 matrix products
    "others_cores": float,  # cores that other work took meanwhile
}
SCORES: Schema = {  # scores.csv: one figure of one method on one capture a line
    "capture": str,  # the capture
    "method": str,  # id of the method
    "reference": str,  # what was scored against; empty for seconds and for the precision
    # none: unsmoothed, window: the same averaging for all, both on the pixels that all methods see;
    # empty: each method as it is
    "treatment": str,
    # the frame, from 0; of strongest_z_m the repeat, of seconds the number of the image
    "frame": int,
    # id of the metric; strongest_z_m: depth of the strongest scatterer in m; or of a moving scene
    # speed_mm_s: mean |radial velocity| of its surface, step_time_s: time from one tone to the
    # next, start_s: start of the frame
    "metric": str,
    "value": float,  # the figure, in the metric's unit
}
COMPARISONS: Schema = {  # one pair of methods by one metric a line
    "metric": str,  # id of the metric
    "better": str,  # id of the method with the better figure
    "worse": str,  # id of the other
    "difference": float,  # by how much `better` is better on the captures that both have, ≥ 0
    "low": float,  # lower end of its 95 % interval
    "high": float,  # upper end
    "unit": str,  # the metric's unit
    "p_corrected": float,  # p of no difference, after Holm over all pairs of the metric
    "effect": float,  # Cohen's dz: the mean over the deviation of the captures' differences
    "reference": str,  # what both were scored against
    "n_captures": int,  # captures
    "sentence": str,  # the finding in words
    "treatment": str,  # as in SCORES
}
DIFFERENCES: Schema = {  # compare.csv: a figure of A and B by metric, method, reference, capture
    "method": str,  # id of the method
    "title": str,  # the method's title
    "metric": str,  # id of the metric
    "metric_title": str,  # as it is printed
    "unit": str,  # the metric's unit
    "reference": str,  # what both were scored against; empty for the precision and the time
    "capture": str,  # the capture; empty: the mean over the captures, of times the median
    "a": float,  # A's figure
    "a_low": float,  # lower end of its 95 % interval
    "a_high": float,  # upper end
    "b": float,  # B's figure
    "b_low": float,  # lower end of its 95 % interval
    "b_high": float,  # upper end
    "difference": float,  # B − A
    "low": float,  # lower end of its 95 % interval
    "high": float,  # upper end
    "p_corrected": float,  # p of no difference, after Holm over all lines; none: not tested
    "untested": str,  # why a mean's difference is not tested
    "paired": bool,  # both are from the same captures
    "n_a": int,  # captures of A
    "n_b": int,  # captures of B
    "better": str,  # A or B where a difference is shown at 5 % for all lines together
    "sentence": str,  # the finding in words
}
CHANGES: Schema = {  # in compare.json: what two results do not share
    "what": str,  # configuration, settings, version, machine or input
    "key": str,  # its name
    "a": str,  # in A; empty: not there
    "b": str,  # in B
}


def frame(
    schema: Schema, rows: Iterable[Mapping[str, Any]] | Iterable[Sequence[Any]] = ()
) -> pd.DataFrame:
    """Make a DataFrame with the columns and types of a schema.
    rows: one entry for each line, either column → value, or the values in the order of the columns.
    None: unknown."""
    import pandas as pd

    return conform(pd.DataFrame(list(rows), columns=list(schema)), schema)


def conform(table: pd.DataFrame, schema: Schema) -> pd.DataFrame:
    """Return the table with the columns and types that its schema declares.
    Raises ValueError for unknown values, except in columns of real numbers, which hold NaN."""
    for name, kind in schema.items():
        if kind is not float and table[name].hasnans:
            raise ValueError(f"the column '{name}' has empty cells")
    dtypes: Any = schema
    return table[list(schema)].astype(dtypes).reset_index(drop=True)


def each(table: pd.DataFrame) -> Iterator[Any]:
    """Return an iterator over the lines of a table, each as a named tuple with the table's
    columns."""
    return iter(table.itertuples(index=False))


def read(path: Path, schema: Schema) -> pd.DataFrame:
    """Read a table from a CSV file that handbench wrote.
    Raises HandbenchError for a file with other columns, and for a cell that is not of its column's
    type, naming the line."""
    import pandas as pd

    names = list(schema)
    try:
        text = read_text(path, f"a CSV file with the columns {', '.join(names)}", RESULT_BYTES)
        if text[-1:] not in ("", "\n"):
            raise ValueError("its last line has no end, so it was cut")
        if (count := sum(map(text.count, ",\n"))) > MOST_CELLS:
            raise ValueError(f"it has about {count} cells, more than {MOST_CELLS}")
        head, *lines = csv.reader(io.StringIO(text), strict=True) if text else [[]]
        if head != names:
            raise ValueError(
                f"the columns are {', '.join(head)[:200]!r}; expected {', '.join(names)}"
            )
        for number, line in enumerate(lines, 2):
            if len(line) != len(names):
                raise ValueError(f"line {number} has {len(line)} columns; expected {len(names)}")
        cells = pd.DataFrame(lines, columns=names, dtype="str")
        table = pd.DataFrame({name: _typed(cells[name], kind) for name, kind in schema.items()})
        return conform(table, schema)
    except (ValueError, OverflowError, csv.Error) as error:
        raise HandbenchError(
            f"{path}: {' '.join(str(error).split())}; run the benchmark again"
        ) from None


def _typed(cells: pd.Series, kind: type) -> pd.Series:
    """Convert the text of a column's cells to its type. Raises ValueError for text of another type.
    The index of `cells` is the number of the line less 2."""
    import pandas as pd

    if kind is str:
        return cells
    numbers = pd.to_numeric(cells, errors="coerce")
    real = ~np.isfinite(numbers) & (cells != "")
    wrong = real if kind is float else numbers.isna() | (numbers % 1 != 0)
    if wrong.any():
        line = int(wrong.to_numpy().argmax())
        raise ValueError(
            f"in line {line + 2}, '{cells.name}' is {cells[line][:60]!r}; expected {EXPECTED[kind]}"
        )
    if kind is float:  # not `numbers`, which may differ in the last bit
        return cells.where(cells != "", "nan").astype("float64")
    return cells.astype(int)


def write(path: Path, table: pd.DataFrame, schema: Schema) -> None:
    """Write a table to a CSV file with a header line, atomically. Values that are not finite become
    empty cells."""
    flags = {name: int for name, kind in schema.items() if kind is bool}
    cells = conform(table, schema).replace([np.inf, -np.inf], np.nan).astype(flags)
    with atomic_path(path) as temporary:
        cells.to_csv(temporary, index=False, lineterminator="\n")
