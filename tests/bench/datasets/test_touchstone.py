"""Touchstone files, written here word by word from the format's definition."""

import cmath
import math

import numpy as np
import pytest

import handbench as hb
from handbench.bench.datasets.touchstone import import_touchstone
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray, BistaticScan, PlanarScan
from handbench.support.errors import HandbenchError

C = 299_792_458.0
GHZ = [2.0, 3.5, 5.25]
POINT = (0.02, -0.01, 0.3)
HEADER = "file,tx_x_m,tx_y_m,tx_z_m,rx_x_m,rx_y_m,rx_z_m\n"


def s21(ghz, tx, rx):
    path = math.dist(tx, POINT) + math.dist(POINT, rx)
    return 0.4 * cmath.exp(-2j * math.pi * ghz * 1e9 * path / C)


def two_port(tx, rx, option="# GHz S RI R 50", unit=1.0, form="RI", wrapped=False):
    def pair(value):
        if form == "RI":
            return f"{value.real!r} {value.imag!r}"
        size = abs(value) if form == "MA" else 20 * math.log10(abs(value))
        return f"{size!r} {math.degrees(cmath.phase(value))!r}"

    lines = ["! made by hand", option, "! f S11 S21 S12 S22"]
    for ghz in GHZ:
        values = [0.9j, s21(ghz, tx, rx), 0.3 + 0.1j, -0.8]
        parts = [f"{ghz * unit!r} {pair(values[0])}", *map(pair, values[1:])]
        lines.append(("\n  " if wrapped else " ").join(parts) + " ! a tone")
    return "\r\n".join(lines) + "\r\n"


def folder_of(tmp_path, files, places, header=HEADER):
    rows = [",".join([name, *map(str, (*tx, *rx))]) for name, (tx, rx) in places.items()]
    (tmp_path / "positions.csv").write_text(header + "\n".join(rows) + "\n")
    for name, text in files.items():
        (tmp_path / name).write_bytes(text.encode("latin-1"))
    return tmp_path


PAIRS = {
    f"{t}{r}.s2p": ((0.05 * t, 0.0, 0.0), (0.0, 0.04 * r, 0.0)) for t in (1, 2) for r in (1, 2)
}


@pytest.mark.parametrize(
    ("option", "unit", "form", "wrapped"),
    [
        ("# GHz S RI R 50", 1.0, "RI", False),
        ("#hz ri r 75 s", 1e9, "RI", True),
        ("#", 1.0, "MA", False),  # the standard's defaults
        ("# R 50.0 DB S MHZ\n# Hz Z RI R 1", 1e3, "DB", False),  # only the first counts
        ("# kHz", 1e6, "MA", False),
    ],
)
def test_an_array_of_two_ports(tmp_path, capsys, option, unit, form, wrapped):
    noise = f"{unit!r} 2.5 0.5 45 10\n{2 * unit!r} 2.7 0.5 45 10\n"
    files = {name: two_port(*at, option, unit, form, wrapped) + noise for name, at in PAIRS.items()}
    source, out = folder_of(tmp_path, files, PAIRS), tmp_path / "array"
    assert main(["import", "touchstone", str(source), "-o", str(out)]) == 0
    assert f"the capture is in {out}" in capsys.readouterr().err
    echoes = hb.load(out).echoes
    assert isinstance(echoes.aperture, AntennaArray)
    assert echoes.frequencies_hz == pytest.approx([2e9, 3.5e9, 5.25e9], rel=1e-12)
    expected = [
        [[s21(f, tx, rx) for rx in echoes.aperture.rx_m] for tx in echoes.aperture.tx_m]
        for f in GHZ
    ]
    np.testing.assert_allclose(echoes.samples[0], expected, atol=1e-6)


def test_one_port_that_is_moved_is_a_scan_and_a_parameter_can_be_chosen(tmp_path):
    places = {f"{k}.S1P": ((0.01 * k, 0.0, 0.0),) * 2 for k in range(3)}
    files = {
        name: "# GHz S RI R 50\n1 0.5 -0.25\n2 0.125 1\n".replace("0.5", f"{k}.5")
        for k, name in enumerate(places)
    }
    import_touchstone(folder_of(tmp_path, files, places), tmp_path / "scan")
    echoes = hb.load(tmp_path / "scan").echoes
    assert isinstance(echoes.aperture, PlanarScan)
    assert echoes.aperture.position_m[:, 0].tolist() == [0, 0.01, 0.02]
    assert echoes.samples[0].tolist() == [[0.5 - 0.25j, 1.5 - 0.25j, 2.5 - 0.25j], [0.125 + 1j] * 3]


@pytest.mark.parametrize(("parameter", "value"), [("S11", 0.9j), ("S12", 0.3 + 0.1j)])
def test_another_parameter(tmp_path, parameter, value):
    places = {f"{k}.s2p": ((0.01 * k, 0.1, 0.0), (0.01 * k, 0.0, 0.0)) for k in range(12)}
    files = {name: two_port(*at) for name, at in places.items()}
    source, out = folder_of(tmp_path, files, places), tmp_path / "out"
    asked = ["--set", f"parameter={parameter}"]
    assert main(["import", "touchstone", str(source), "-o", str(out), *asked]) == 0
    echoes = hb.load(out).echoes
    assert isinstance(echoes.aperture, BistaticScan)  # twelve pairs of 144
    np.testing.assert_allclose(echoes.samples, value, atol=1e-7)


GOOD = "# GHz S RI R 50\n1 0.5 0\n2 0.5 0\n"
ROW = "a.s1p,0,0,0,0,0,0\n"


@pytest.mark.parametrize(
    ("files", "rows", "message"),
    [
        ({}, "", "positions.csv: lists no file"),
        ({}, ROW, "a.s1p: expected a Touchstone file, found nothing"),
        ({"a.s1p": GOOD}, "a.s1p,0,0\n", "line 2 has 3 columns; expected 7"),
        ({"a.s1p": GOOD}, "a.s1p,0,0,0,0,0,x\n", "line 2: could not convert"),
        ({"a.s1p": GOOD}, "a.s1p,0,0,0,0,0,nan\n", "NaN or infinite"),
        (
            {"a.s1p": GOOD},
            ROW + "a.s1p,1,0,0,0,0,0\n",
            "line 3 repeats the file or the position of line",
        ),
        ({"a.s1p": GOOD, "b.s1p": GOOD}, ROW + ROW.replace("a.", "b."), "the position of line 2"),
        ({}, "../a.s1p,0,0,0,0,0,0\n", "is outside the folder"),
        (
            {"a.s3p": GOOD},
            ROW.replace("s1p", "s3p"),
            "not a Touchstone file; expected a name that ends in .s1p",
        ),
        ({"a.s1p": "1 0.5 0\n"}, ROW, "line 1 is before the option line; expected '#'"),
        ({"a.s1p": "# GHz Y RI\n1 0.5 0\n"}, ROW, "line 1 has the option 'Y'"),
        ({"a.s1p": "# GHz R x\n1 0.5 0\n"}, ROW, "line 1 has the option 'R'"),
        (
            {"a.s1p": "[Version] 2.0\n" + GOOD},
            ROW,
            "line 1 is '[Version] 2.0', which is Touchstone version 2",
        ),
        ({"a.s1p": GOOD + "3 0.5 O\n"}, ROW, "line 4 is '3 0.5 O'; expected 3"),
        ({"a.s1p": GOOD + "3 0.5 0 1\n"}, ROW, "line 4 is '3 0.5 0 1'; expected 3"),
        ({"a.s1p": GOOD + "3 0.5 inf\n"}, ROW, "line 4 is '3 0.5 inf'; expected 3"),
        (
            {"a.s1p": GOOD + "2 0.5 0\n"},
            ROW,
            "line 4 has the frequency 2; expected one above the frequency before it, 2",
        ),
        ({"a.s1p": GOOD + "3 0.5\n"}, ROW, "ends at line 4 with 2 numbers; expected 3"),
        ({"a.s1p": "# Hz\n"}, ROW, "ends at line 1 with 0 numbers"),
        ({"a.s1p": "# DB\n1 900 0\n"}, ROW, "S11 has a magnitude of 1e+45; expected"),
        (
            {"a.s1p": GOOD, "b.s1p": GOOD.replace("2 ", "3 ")},
            ROW + "b.s1p,1,0,0,0,0,0\n",
            "b.s1p: has 2 tones in 1–3 GHz, but a.s1p has 2 tones in 1–2 GHz",
        ),
        ({"a.s1p": "!" + "x" * 2**23}, ROW, "too many for a Touchstone file (at most 8388608)"),
    ],
)
def test_what_is_refused(tmp_path, files, rows, message):
    folder_of(tmp_path, files, {}, HEADER + rows)
    with pytest.raises(HandbenchError) as caught:
        import_touchstone(tmp_path, tmp_path / "out")
    assert message in str(caught.value)
    assert str(tmp_path) in str(caught.value) or "positions.csv" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_s21_of_one_port_and_an_unknown_setting_are_refused(tmp_path, capsys):
    source = folder_of(tmp_path, {"a.s1p": GOOD}, {}, HEADER + ROW)
    command = ["import", "touchstone", str(source), "-o", str(tmp_path / "out"), "--set"]
    assert main([*command, "parameter=S21"]) == 2
    assert "a.s1p: has only S11, but S21 is requested" in capsys.readouterr().err
    assert main([*command, "port=2"]) == 2
    assert "--set: unknown key 'port'" in capsys.readouterr().err
