"""A small part of the fuzzing, and all that it ever found."""

import os
import time
from pathlib import Path

import pytest

from tests.fuzz import __main__ as tool
from tests.fuzz.__main__ import Input, corpus, fuzz, line_of, planned
from tests.fuzz.readers import READERS, Reader

CORPUS = Path(__file__).parent / "corpus" / "found.jsonl"
INPUTS = 500


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of what is made broken, while it is made
def test_new_inputs_and_the_corpus_find_nothing():
    """Each is accepted or refused in words: no other exception, no hang, no crash, no memory,
    nothing written."""
    seen = list(fuzz([*corpus(CORPUS), *planned(INPUTS, seed=7)]))
    assert [
        (given.reader, given.file, v, why) for given, v, why in seen if v not in tool.FINE
    ] == []
    assert {given.reader for given, *_ in seen} == {reader.name for reader in READERS}
    verdicts = [verdict for _, verdict, _ in seen]
    assert verdicts.count("refused") > verdicts.count("accepted") > INPUTS / 20


BAD = {
    "exception": lambda folder: {}["missing"],
    "memory": lambda folder: bytearray(10 * 2**30),
    "hang": lambda folder: time.sleep(600),
    "crash": lambda folder: os.kill(os.getpid(), 9),
    "wrote": lambda folder: (folder.parent / "elsewhere").touch(),
}


def misbehaving(link, root):
    """A worker of a reader that does what its input says."""

    def read(folder):
        word = (folder / "a").read_text()
        if word:
            BAD[word](folder)

    reader = Reader("bad", lambda folder: (folder / "a").touch(), read, ("a",))
    tool.work(link, root, (reader,))


@pytest.mark.slow
def test_what_a_reader_must_not_do_is_found(monkeypatch):
    """And good inputs are read afterwards, by a new process if need be."""
    monkeypatch.setattr(tool, "HANG_S", 5.0)
    words = [word for bad in BAD for word in (bad, "")]
    found = list(fuzz([Input("bad", "a", word.encode()) for word in words], misbehaving))
    assert [verdict for _, verdict, _ in found] == [word or "accepted" for word in words]


def test_a_finding_comes_back_from_the_corpus(tmp_path):
    given = Input("scene", "scene.toml", b"\xff broken")
    (tmp_path / "found.jsonl").write_text(line_of(given, "exception: …") + "\n", encoding="utf-8")
    assert list(corpus(tmp_path / "found.jsonl")) == [given]
