"""The ratchet of types counts, refuses what rises and says what can be lowered. (`make lint` runs
it on the code.)"""

import json

import pytest

from tests import typing_ratchet
from tests.typing_ratchet import ROOMS, STRICT, counted, room, verdict

OUTPUT = """radar/data/grid.py:69: error: Argument 2 has incompatible type  [arg-type]
radar/data/grid.py:69: note: a hint
bench/evaluation/metrics.py:3: error: x  [misc]
bench/run/runner.py:4: error: y  [misc]
bench/run/runner.py:5: error: z  [misc]
Found 4 errors in 3 files (checked 349 source files)"""


def test_errors_count_in_the_innermost_room():
    assert counted(OUTPUT.splitlines()) == dict.fromkeys(ROOMS, 0) | {
        "radar": 1,
        "bench/evaluation": 1,
        "bench": 2,
    }


def test_a_file_of_no_room_is_noticed():
    with pytest.raises(ValueError):
        room("elsewhere/a.py")


@pytest.mark.parametrize(
    ("bench", "radar", "risen", "fallen"),
    [(5, 0, [], []), (6, 0, ["bench"], []), (4, 0, [], ["bench"]), (5, 1, ["radar"], [])],
)
def test_counts_may_fall_and_not_rise_and_strict_rooms_have_none(bench, radar, risen, fallen):
    found = dict.fromkeys(ROOMS, 0) | {"bench": bench, "radar": radar}
    more, fewer = verdict(found, {"bench": 5, "radar": 9})
    assert ([line.split(":")[0] for line in more], [line.split(":")[0] for line in fewer]) == (
        risen,
        fallen,
    )


def test_the_record_is_of_the_rooms_that_are_not_strict():
    assert set(json.loads(typing_ratchet.RECORD.read_text("utf-8"))) == set(ROOMS) - set(STRICT)
