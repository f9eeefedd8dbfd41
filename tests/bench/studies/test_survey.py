"""Cameras against a survey, on photographs of a room whose cameras are known."""

from tests.bench.studies import measure_survey as survey
from tests.groundtruth import room

VIEWS = 4


def test_features_are_found_once_and_figures_repeat(tmp_path, monkeypatch):
    (tmp_path / "images").mkdir()
    room.photograph(tmp_path / "images", VIEWS)
    (tmp_path / "K.txt").write_text("440 0 200 0 440 150 0 0 1")
    centres_m = {f"p{i}.png": centre_m for i, centre_m in enumerate(room.around(VIEWS))}
    made, prepare = [], survey._prepare
    monkeypatch.setattr(survey, "_prepare", lambda *given: made.append(prepare(*given)))
    case = survey.Case(tuple(centres_m), "all", 1, True, 0)
    first, again = (survey.measure(case, tmp_path, centres_m, tmp_path / "work") for _ in range(2))
    assert len(made) == 1 and first == again
    assert [record["way"] for record in first] == ["handbench", "plain COLMAP"]
    assert all(record["registered"] == VIEWS and record["centre_m"] < 1e-3 for record in first)
