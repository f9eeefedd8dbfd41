"""Wrong chirp profiles of simulated raw captures are named from the echoes; right ones are not."""

from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.ti_checks import mistake
from handbench.bench.datasets.ti_profile import ChirpProfile
from handbench.cli.main import main
from tests.bench.datasets.ti_captures import MISTAKES, draw_capture, draw_mistaken, undone

CHAIR = Path(__file__).parents[3].parent / "shared" / "data" / "chair60" / "raw" / "adc"
CHAIRS = {
    "start_hz": 60e9,
    "slope_hz_s": 29.982e12,
    "adc_start_s": 0,
    "rate_hz": 2.047e6,
    "samples": 256,
    "receivers": [1, 2, 3, 4],
    "transmitters": [1, 3],
    "loops": 32,
    "board": "IWR6843ISK",
}


def changes_found(folder, content, profile):
    numbers = np.frombuffer(content, "<i2")
    found = mistake(folder, numbers, ChirpProfile.model_validate(profile))
    return found[0] if found else []


def is_named(folder, kind, seed):
    rng = np.random.default_rng([seed, MISTAKES.index(kind)])
    capture, wrong = draw_mistaken(rng, kind)
    capture.write(folder, wrong, kind == "exchanged" or bool(rng.random() < 0.5))
    changes = changes_found(folder, capture.content, wrong)
    return any(undone(change, wrong, capture.profile, kind) for change in changes)


def is_blamed(folder, seed):
    rng = np.random.default_rng([seed, 99])
    capture = draw_capture(rng, bool(rng.random() < 0.5))
    capture.write(folder, capture.profile, bool(rng.random() < 0.7))
    return bool(changes_found(folder, capture.content, capture.profile))


@pytest.mark.parametrize("kind", MISTAKES)
def test_a_mistake_is_named(tmp_path, kind):
    assert is_named(tmp_path / "raw", kind, 1)


@pytest.mark.parametrize("seed", range(4))
def test_a_right_profile_is_not_blamed(tmp_path, seed):
    assert not is_blamed(tmp_path / "raw", seed)


@pytest.mark.slow
def test_of_fifty_mistakes_nine_in_ten_are_named_and_no_two_right_profiles(tmp_path):
    kinds = (MISTAKES * 7)[:50]
    named = [is_named(tmp_path / f"w{k}", kind, 1 + k) for k, kind in enumerate(kinds)]
    blamed = [is_blamed(tmp_path / f"r{k}", 1 + k) for k in range(50)]
    assert sum(named) >= 45, [kind for kind, found in zip(kinds, named, strict=True) if not found]
    assert sum(blamed) <= 1


def test_inspect_and_import_print_what_to_set(tmp_path, capsys):
    capture, wrong = draw_mistaken(np.random.default_rng(1), "order")
    source = tmp_path / "raw"
    capture.write(source, wrong, places=True)
    asked = f"--set order={capture.profile['order']}"
    assert main(["inspect", str(source)]) == 0
    printed = capsys.readouterr().out
    assert f"{source}: warning: 100 % of the echoes' power has negative beat freq" in printed
    assert f"may be wrong: {asked} fits" in printed
    command = ["import", "ti-raw", str(source), "-o", str(tmp_path / "out")]
    assert main(command) == 0
    assert f"may be wrong: {asked} fits" in capsys.readouterr().err
    assert main([*command, "--overwrite", *asked.split()]) == 0
    assert "wrong" not in capsys.readouterr().err
    (source / "adc_data.bin").write_bytes(capture.content[:-4])
    assert main(["inspect", str(source)]) == 2
    assert "not a whole number of frames" in capsys.readouterr().out


@pytest.mark.skipif(not CHAIR.is_dir(), reason=f"the chair's captures are not at {CHAIR}")
@pytest.mark.parametrize(
    ("wrong", "cure"),
    [
        ({}, None),
        ({"lanes": 4}, {"lanes": 2}),
        ({"order": "QI"}, {"order": "IQ"}),
        ({"samples": 128}, {"samples": 256}),
        ({"receivers": [1, 2], "loops": 64}, {"receivers": (1, 2, 3, 4)}),
        ({"transmitters": [1] * 32 + [3] * 32, "loops": 1}, {"transmitters": (1, 3), "loops": 32}),
        ({"transmitters": [3, 1]}, {"transmitters": (1, 3)}),
        ({"loops": 64}, {"loops": 32}),
    ],
)
def test_a_boards_own_captures(tmp_path, wrong, cure):
    content = b"".join((CHAIR / f"{k}.bin").read_bytes() for k in (1, 2, 3, 4))
    assert changes_found(tmp_path, content, CHAIRS | wrong) == ([cure] if cure else [])
