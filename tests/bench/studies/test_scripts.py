"""Studies that lie with the tests are imported and made, and refuse what no case has before they
measure."""

from __future__ import annotations

from importlib import import_module

import pytest

NEEDED = {
    "registration.measure_registration": ["faults"],
    "exact.measure_exact": [],
    "renderers.measure_renderers": [],
    "engine.measure_engine": [],
    "engine.foreign_engines": [],
    "measure_survey": ["."],
    "measure_noise_fit": ["paper_table"],
    "ablation.measure_auto": [],
    "ablation.measure_ablation": ["--poses", "B"],
    "photogrammetry.measure_photogrammetry": ["bars"],
    "trust.measure_trust": [],
    "sensitivity.measure_sensitivity": ["paper_table"],
}


@pytest.fixture
def survey(tmp_path, monkeypatch):
    """Names of photographs and cameras, in a folder of their own, which is the current one."""
    monkeypatch.chdir(tmp_path)
    for folder in ("cameras", "images"):
        (tmp_path / folder).mkdir()
    for number in range(5):
        (tmp_path / "images" / f"{number}.jpg").touch()
        (tmp_path / "cameras" / f"{number}.jpg.camera").write_text(" ".join(map(str, range(26))))


@pytest.mark.usefixtures("survey")
@pytest.mark.parametrize("script", NEEDED)
def test_a_script_makes_its_study(script, monkeypatch, capsys):
    module = import_module(f"tests.bench.studies.{script}")
    monkeypatch.setattr(
        "sys.argv", [script, *NEEDED[script], "--only", "no such case", "-o", "out"]
    )
    with pytest.raises(SystemExit) as ended:
        module.main()
    assert ended.value.code == 2
    assert f"python -m {module.__name__}: --only: no case of '" in capsys.readouterr().err
