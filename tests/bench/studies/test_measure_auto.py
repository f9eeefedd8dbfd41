"""Auto's promise on a scene of a file."""

import pytest

from handbench.bench.studies.ablation import measure_auto


@pytest.mark.slow
def test_auto_keeps_its_tolerance_on_a_sphere(ran, monkeypatch, tmp_path):
    monkeypatch.setattr(measure_auto, "PIXEL_M", 0.01)
    (tmp_path / "ball.toml").write_text(
        'version = 1\nname = "ball"\n[target]\nkind = "sphere"\nradius_m = 0.03\nedge_m = 4e-3\n'
        "[sensor]\nsweep = []\ntones_hz = [82e9, 81.8e9, 81.3e9, 79.5e9, 72e9]\n"
        "oscillator = { level_dbc_hz = -200.0 }\n[noise]\nphase_noise_rad = 1e-9\n"
    )
    found = ran(measure_auto, str(tmp_path / "ball.toml"), "--tolerances", "0.1")
    [row], [summary] = found["rows"], found["summary"]
    assert row["kept"] and row["3fsk_mm"] < 0.1 and row["ratio"] > 0
    assert (summary["scenes"], summary["kept"]) == (1, 1)
