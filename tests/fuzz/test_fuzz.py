"""A small part of the fuzzing, and all that it ever found."""

import random
from pathlib import Path

import pytest

from tests.fuzz.campaign import FINDINGS, Worker, corpus, fuzz, line_of, planned
from tests.fuzz.mutate import mutated
from tests.fuzz.readers import READERS
from tests.fuzz.worker import Input, Seen

CORPUS = Path(__file__).parent / "corpus" / "found.jsonl"
INPUTS = 500


@pytest.mark.filterwarnings("ignore")  # of what is made broken, while it is made
def test_new_inputs_and_the_corpus_find_nothing():
    """Each is accepted or refused in words: no other exception, no hang, no crash, no memory,
    nothing written."""
    inputs = [*corpus(CORPUS), *planned(INPUTS, seed=7)]
    seen = [(given, found) for given, found, _ in fuzz(inputs)]
    assert [
        (given.reader, given.file, found) for given, found in seen if found.verdict in FINDINGS
    ] == []
    assert {given.reader for given, _ in seen} == {reader.name for reader in READERS}
    verdicts = [found.verdict for _, found in seen]
    assert verdicts.count("refused") > verdicts.count("accepted") > INPUTS / 20


def test_inputs_are_the_same_for_the_same_seed():
    content = b"x = 1\ny = [2, 3]\n"
    made = [
        [mutated("a.toml", content, random.Random(f"{seed} {k}")) for k in range(50)]
        for seed in (1, 1, 2)
    ]
    assert made[0] == made[1] != made[2]


READS = {
    "exception": "{}['missing']",
    "memory": "bytearray(10 * 2**30)",
    "hang": "time.sleep(600)",
    "slow": "end = time.process_time() + 1.1\n        while time.process_time() < end: pass",
    "crash": "os.kill(os.getpid(), 9)",
    "wrote": "open(folder.parent / 'elsewhere', 'w').close()",
}


@pytest.mark.parametrize("verdict", READS)
def test_what_a_reader_must_not_do_is_found(verdict, tmp_path, monkeypatch):
    """Readers that misbehave, in a worker that knows them too."""
    module = tmp_path / "misbehaving.py"
    module.write_text(
        "import os, time\nfrom tests.fuzz import campaign, worker\nfrom tests.fuzz.readers import "
        "Reader\n\ndef write(folder):\n    (folder / 'a').write_bytes(b'')\n\ndef "
        "read(folder):\n    if (folder / 'a')"
        f".read_bytes():\n        {READS[verdict]}\n\ndef work(link, root):\n"
        "    worker.READERS = (Reader('bad', write, read, ('a',)),)\n    worker.BY_NAME = "
        "{'bad': worker.READERS[0]}\n"
        "    worker.LONGEST_S = 1.0\n    worker.work(link, root)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    import misbehaving

    monkeypatch.setattr("tests.fuzz.campaign.work", misbehaving.work)
    with Worker() as worker:
        assert worker.read(Input("bad", "a", b""))[0].verdict == "accepted"
        with (
            monkeypatch.context() as patience
        ):  # of a minute's sleep half a second is enough to wait for
            patience.setattr("tests.fuzz.campaign.HANG_S", 0.5 if verdict == "hang" else 600.0)
            assert worker.read(Input("bad", "a", b"x"))[0].verdict == verdict
        assert (
            worker.read(Input("bad", "a", b""))[0].verdict == "accepted"
        )  # by a new process, if need be


def test_a_finding_comes_back_from_the_corpus(tmp_path):
    given = Input("scene", "scene.toml", b"\xff broken")
    (tmp_path / "found.jsonl").write_text(
        line_of(given, Seen("exception", "…")) + "\n", encoding="utf-8"
    )
    assert corpus(tmp_path / "found.jsonl") == [given]
