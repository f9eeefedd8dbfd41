"""A study's frame: failures, words for cases that are not there, and the table of a terminal."""

import pytest

from handbench.bench.evaluation.tables import Column
from handbench.bench.studies import study
from handbench.bench.studies.study import Study, Table
from handbench.support.errors import HandbenchError

COLUMNS = (
    Column("name", str, "a name", heading="name"),
    Column("x", float, "a number", heading="x"),
)


def root(case):
    if case < 0:
        raise HandbenchError("below zero")
    return {"name": f"of {case}", "x": case**0.5}


@pytest.fixture
def of(monkeypatch):
    """A study of the roots of some numbers."""
    monkeypatch.setattr(study, "compile_kernels", lambda: None)
    return lambda *cases: Study(
        "roots", cases, root, lambda records: [Table("rows", COLUMNS, records)]
    )


def test_a_case_that_fails_is_recorded_and_the_others_go_on(of, tmp_path):
    [table], failures = study.run(of(4, -1, 9), tmp_path)
    assert table.markdown() == "| name |   x |\n| ---- | --: |\n| of 4 |   2 |\n| of 9 |   3 |\n"
    assert failures == {"-1": "below zero"}
    assert (tmp_path / "roots.csv").read_text() == "name,x\nof 4,2.0\nof 9,3.0\n"


@pytest.mark.parametrize(
    ("cases", "only", "words"),
    [
        ((4, 9), "5", "--only: no case of 'roots' has '5' in its name; the cases are: 4, 9"),
        ((-1, -2), "", "every case failed; the error of the first: below zero"),
    ],
)
def test_a_study_without_records_is_refused(of, tmp_path, cases, only, words):
    with pytest.raises(HandbenchError, match=words):
        study.run(of(*cases), tmp_path, only=only)
