"""Names that read as another's, and maps of nearly no pixel."""

import numpy as np
import pytest

from handbench.bench.evaluation.equal_treatment import taking_part, treated_figures
from handbench.bench.results import load
from handbench.cli.main import main
from handbench.radar.data.depthmap import DepthMap
from handbench.reports.tables.result_tables import markdown
from tests.small_benchmark import BENCH

PLANE_M = np.full((20, 20), 0.3)
AXIS_M = np.linspace(-0.02, 0.02, 21)


def observed(pixels: int) -> np.ndarray:
    """The first pixels, 1 mm behind the plane."""
    z_m = np.full(PLANE_M.size, np.nan)
    z_m[:pixels] = 0.301
    return z_m.reshape(PLANE_M.shape)


@pytest.mark.parametrize(("pixels", "share_percent"), [(0, 50), (3, 50), (4, 1)])
def test_a_map_of_under_one_percent_does_not_decide_the_others_common_pixels(pixels, share_percent):
    maps = {"whole": observed(400), "half": observed(200), "few": observed(pixels)}
    found = treated_figures(taking_part(maps, PLANE_M), PLANE_M)
    assert ("few" in found) == (share_percent == 1)
    assert found["half"]["common_percent"] == pytest.approx(share_percent)


@pytest.mark.slow
def test_the_table_names_the_method_that_is_left_out(small_bench, tmp_path, capsys):
    (tmp_path / "bench" / "maps").mkdir()
    z_m = np.full((21, 21), np.nan)
    z_m[10, 10] = 0.28  # 1 of some 300
    DepthMap(AXIS_M, AXIS_M, z_m, np.zeros(z_m.shape), "x").save(tmp_path / "bench/maps/ball.npz")
    small_bench.write_text(f'{BENCH}[[method]]\nid = "one-pixel"\nmaps = "maps"\n')
    assert main(["run", str(small_bench), "-o", str(tmp_path / "out")]) == 0
    expected = "not compared on common pixels: one-pixel (fewer than 1 % of the surface"
    assert expected in capsys.readouterr().err
    result = load(tmp_path / "out")
    assert expected in result.about.protocol["basis"] and expected in markdown(result)
    assert set(result.equal.method) == {"2fsk", "narrowband"}
    common = result.equal[result.equal.metric == "common_percent"].value
    assert (common > 2).all() and "one-pixel" in set(result.table.method)


@pytest.mark.parametrize("id", ["truth", "com-pleted", "2-FSK", "3 fsk settled", "Ｔruth"])
def test_a_method_s_name_is_neither_a_reference_s_nor_another_method_s(small_bench, capsys, id):
    (small_bench.parent / "maps").mkdir()
    small_bench.write_text(f'{BENCH}[[method]]\nid = "{id}"\nmaps = "maps"\n')
    for command in (["inspect"], ["run", "-o", str(small_bench.parent / "out")]):
        assert main([command[0], str(small_bench), *command[1:]]) == 2
        text = " ".join("".join(capsys.readouterr()).split())
        assert f"'{id}' has the same meaning as" in text and "choose another name" in text


@pytest.mark.parametrize("name", ["truth", "Completed", "3-FSK"])
def test_a_capture_s_name_neither(small_bench, capsys, name):
    scene = small_bench.parent / "ball.toml"
    scene.write_text(scene.read_text().replace('"ball"', f'"{name}"'))
    for command in (["inspect"], ["run", "-o", str(small_bench.parent / "out")]):
        assert main([command[0], str(small_bench), *command[1:]]) == 2
        assert f"'{name}' has the same meaning as" in " ".join("".join(capsys.readouterr()).split())
