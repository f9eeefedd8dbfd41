"""A small part of the fuzzing, and all that it ever found."""

from pathlib import Path

import pytest

from tests.fuzz.__main__ import FINE, corpus, fuzz, planned
from tests.fuzz.readers import READERS

CORPUS = Path(__file__).parent / "corpus" / "found.jsonl"
INPUTS = 500


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of what is made broken, while it is made
def test_new_inputs_and_the_corpus_find_nothing():
    """Each is accepted or refused in words: no other exception, no hang, no crash, no memory,
    nothing written."""
    seen = list(fuzz([*corpus(CORPUS), *planned(INPUTS, seed=7)]))
    assert [(given.reader, given.file, v, why) for given, v, why in seen if v not in FINE] == []
    assert {given.reader for given, *_ in seen} == {reader.name for reader in READERS}
    verdicts = [verdict for _, verdict, _ in seen]
    assert verdicts.count("refused") > verdicts.count("accepted") > INPUTS / 20
