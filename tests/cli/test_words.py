"""Words where people stumble: advice in the caller's form, units, names by meaning, what is
missing."""

import re

import h5py
import numpy as np
import pytest

import handbench as hb
from handbench.cli.main import main
from handbench.support.caller import called_from, option, settings
from handbench.support.config import parse, suggest
from handbench.support.errors import HandbenchError

TONES_HZ = [82e9, 81.9e9, 81e9]


@pytest.fixture
def capture(tmp_path):
    """The folder of a capture of three tones, echoes only."""
    side_m = np.linspace(-0.07, 0.07, 6)
    tx_m = np.stack([side_m, 0 * side_m, 0 * side_m], axis=1)
    folder = tmp_path / "mine"
    folder.mkdir()
    with h5py.File(folder / "echoes.h5", "w") as file:
        file.attrs["format"], file.attrs["version"] = "handbench-echoes", 1
        file["samples"] = np.ones((1, 3, 6, 6), np.complex64)
        file["frequencies_hz"] = TONES_HZ
        file["tx_m"], file["rx_m"] = tx_m, tx_m[:, [1, 0, 2]]
    (folder / "capture.toml").write_text('version = 1\nname = "mine"\n')
    return folder


def in_python(folder):
    try:
        hb.load(folder).reconstruct("2fsk", f1_hz=70e9)
    except HandbenchError as error:
        return str(error)


def on_the_command_line(folder, capsys):
    given = ["--method", "2fsk", "--set", "f1_hz=70e9", "-o", str(folder / "d.npz")]
    assert main(["reconstruct", str(folder), *given]) == 2
    return capsys.readouterr().err


def in_a_benchmark(folder, capsys):
    file = folder.parent / "b.toml"
    file.write_text(
        'version = 1\nname = "b"\n[[capture]]\npath = "mine"\nmeasures = ["precision"]\n'
        '[[method]]\nid = "2fsk"\nprecision = true\nconfig = { f1_hz = 70e9 }\n'
    )
    assert main(["inspect", str(file)]) == 2
    return capsys.readouterr().out


def test_advice_has_the_form_of_its_caller(capture, capsys):
    assert in_python(capture).endswith("e.g. f1_hz=82e9, f2_hz=81.9e9")
    assert "e.g. --set f1_hz=82e9 --set f2_hz=81.9e9\n" in on_the_command_line(capture, capsys)
    advice = "e.g. config = { f1_hz = 82e9, f2_hz = 81.9e9 }\n"
    assert advice in in_a_benchmark(capture, capsys)


def test_settings_within_tables_and_options_have_three_forms():
    given = {"z.start_m": 0.25, "tones_hz": (82e9, 81.9e9)}
    assert settings(given) == 'z={"start_m": 0.25}, tones_hz=[82e9,81.9e9]'
    with called_from("command line"):
        assert settings(given) == "--set z.start_m=0.25 --set tones_hz='[82e9,81.9e9]'"
        assert option("--from-echoes") == "--from-echoes"
        with called_from("benchmark"):
            assert settings(given) == "config = { z.start_m = 0.25, tones_hz = [82e9,81.9e9] }"
    assert option("--from-echoes") == "from_echoes" and option("-o", "folder") == "folder"


@pytest.mark.parametrize(
    ("name", "known", "nearest"),
    [
        ("FSK3", ["2fsk", "3fsk", "broadband"], "3fsk"),
        ("three-tone", ["2fsk", "3fsk", "broadband"], "3fsk"),
        ("SETTLED 2-FSK", ["2fsk", "2fsk-settled", "3fsk-settled"], "2fsk-settled"),
        ("Backprojection", ["2fsk", "broadband"], "broadband"),
        ("aluminium", ["metal", "skin"], "metal"),
        ("broadbnad", ["2fsk", "broadband"], "broadband"),
    ],
)
def test_a_name_of_the_same_meaning_is_suggested(name, known, nearest):
    assert suggest(name, known) == f"did you mean '{nearest}'?"
    assert suggest("xyz", known) == f"known: {', '.join(sorted(known))}"


SCENE = 'version = 1\nname = "s"\n[target]\nkind = "sphere"\n{}\n[sensor]\n{}\n'


@pytest.mark.parametrize(
    ("target", "sensor", "words"),
    [
        (
            "radius_m = 30",
            "",
            "'target.radius_m' is 30; .*; if that is in millimetres, multiply it by 0.001",
        ),
        ("distance_m = 310", "", "'target.distance_m' is 310; .* in millimetres, multiply"),
        ("offset_m = [0, -300]", "", "'target.offset_m.1' is -300; .* in millimetres, multiply"),
        ("", "tones_hz = [82.0]", "'sensor.tones_hz.0' is 82.0; .*; if that is in gigahertz"),
        ("", "sweep = [{ start_hz = 72e3, stop_hz = 82e9, count = 2 }]", "if that is in megahertz"),
        (
            "",
            "sweep = [{ start_hz = 7e9, stop_hz = 8e13, count = 2 }]",
            "a thousand times too much",
        ),
        ("radius_m = -30", "", "'target.radius_m' is -30; input should be greater than 0$"),
    ],
)
def test_a_length_or_frequency_in_another_unit_is_asked_about(
    target, sensor, words, tmp_path, capsys
):
    (tmp_path / "s.toml").write_text(SCENE.format(target, sensor))
    assert main(["inspect", str(tmp_path / "s.toml")]) == 2
    assert re.search(words.replace("?", r"\?"), capsys.readouterr().out.splitlines()[0])


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("f1_hz=82", "'f1_hz' is 82; .*gigahertz"),
        ("first_depth_m=310", "'first_depth_m' is 310; .*millimetres"),
        ("x.start_m=-150", "'x.start_m' is -150; .*millimetres"),
        ("x.step_m=1", "step_m = 1 is longer than the axis.*millimetres"),
    ],
)
def test_settings_in_another_unit_are_asked_about(setting, words, capture, tmp_path, capsys):
    given = ["--method", "3fsk", "-o", str(tmp_path / "d.npz"), "--set", setting]
    assert main(["reconstruct", str(capture), *given]) == 2
    assert re.search(words, capsys.readouterr().err)


def test_every_tone_of_a_method_has_the_unit_hint():
    from handbench.radar.methods.registry import methods

    for method in methods():
        for name in method.config.model_fields:
            if name.endswith("_hz"):
                value = [82.0, 81.0, 80.0] if name == "tones_hz" else 82.0
                with pytest.raises(HandbenchError, match=f"'{name}.*if that is in gigahertz"):
                    parse(method.config, {name: value}, method.id)


@pytest.mark.parametrize(
    ("kind", "nearest"), [("ball", "sphere"), ("Hand", "hand"), ("reflector", "dihedral")]
)
def test_an_unknown_kind_of_target_has_a_suggestion(kind, nearest, tmp_path, capsys):
    text = SCENE.format("", "").replace("sphere", kind)
    (tmp_path / "s.toml").write_text(text)
    assert main(["inspect", str(tmp_path / "s.toml")]) == 2
    assert f"'target.kind' is '{kind}'; did you mean '{nearest}'?" in capsys.readouterr().out


def test_echoes_alone_are_fine_and_missing_frequencies_are_named(capture, capsys):
    assert main(["inspect", str(capture)]) == 0
    assert "score" not in capsys.readouterr().out
    with h5py.File(capture / "echoes.h5", "a") as file:
        del file["frequencies_hz"]
    assert main(["inspect", str(capture)]) == 2
    words = "'frequencies_hz' [frequency], hertz (samples have shape (1, 3, 6, 6)); add"
    assert words in capsys.readouterr().out


def test_the_package_has_the_version_of_the_command(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"handbench {hb.__version__}\n"
