"""The ranking of several results: order, ranks and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.bench.evaluation.tables import SCORES, frame
from handbench.bench.results import MethodFacts, load
from handbench.bench.results.ranking import rank_methods
from handbench.support.errors import HandbenchError

NAMES = tuple("ABCDEFGH")


@pytest.fixture
def result(small_result):
    """Makes a result of methods, each with its shares right within 2 mm by capture."""
    known = load(small_result)

    def make(folder, names=NAMES, inputs=None, reference="truth", **shares_percent):
        methods = tuple(MethodFacts(name=name, title=name.upper()) for name in shares_percent)
        lines = []
        for name, shares in shares_percent.items():
            for capture, share in zip(names, np.broadcast_to(shares, len(names)), strict=True):
                about_map = capture, name, reference, "", 0
                lines += [(*about_map, "complete_2mm_percent", share), (*about_map, "mae_mm", 2.0)]
        about = known.about.model_copy(update={"methods": methods, "inputs": inputs or {}})
        return replace(
            known, folder=known.folder / folder, about=about, files={"scores": frame(SCORES, lines)}
        )

    return make


def test_methods_between_which_nothing_is_shown_share_a_rank(result):
    """Shares 50 % ± 1, the same with other noise of ± 1, and 10 % less: 8 pairs show 10 and not
    0.01."""
    noise = np.array([1, -1, 1, -1, 1, -1, 1, -1.0])
    a = result("a", first=50 + noise, third=40 + noise[::-1])
    b = result("b", second=49.99 + np.roll(noise, 2) * [1, 1, 1, 1, -1, -1, -1, -1])
    table, about = rank_methods([a, b])
    assert table.method.tolist() == ["FIRST", "SECOND", "THIRD"]
    assert table["rank"].tolist() == [1, 1, 3]
    assert table.result.tolist() == [str(a.folder), str(b.folder), str(a.folder)]
    assert table.complete_2mm_percent.tolist() == pytest.approx([50, 49.99, 40])
    assert "8 captures that all results have, against truth" in about


def test_captures_that_one_result_lacks_are_left_out(result):
    a = result("a", names=("A", "B"), one=[10.0, 90.0], inputs={"B": "1"})
    b = result("b", names=("B", "C"), two=[80.0, 0.0], inputs={"B": "2"})
    table, about = rank_methods([a, b])
    assert table.complete_2mm_percent.tolist() == [90, 80]
    assert table["rank"].tolist() == [0, 0] and "too few captures to test" in about
    assert "different content hashes in the results: B." in about


def test_results_that_share_nothing_are_refused(result):
    a, b = result("a", names=("A",), one=1.0), result("b", names=("A",), two=1.0)
    of_maroon = b.about.model_copy(update={"protocol": {"id": "maroon", "version": 1}})
    for other, words in (
        (result("b", names=("A",), reference="photogrammetry", two=1.0), "no capture in common"),
        (replace(b, about=of_maroon), "the scoring protocols"),
    ):
        with pytest.raises(HandbenchError, match=words):
            rank_methods([a, other])
