"""The engine's benchmark: its yardsticks are right, and every section writes its rows."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numba
import numpy as np
import pytest

from handbench.bench.studies.engine import measure_engine, textbook, turns, volume_rows
from handbench.bench.studies.engine.scope import QUICK, Inputs, white_noise
from handbench.bench.studies.engine.textbook import numba_sum, numpy_sum, range_compressed
from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.grid import Axis
from handbench.radar.simulation.forward import Scatterers
from tests.radar.direct_sums import direct_sum
from tests.radar.samples import relative_error

TONES_HZ = np.linspace(72e9, 82e9, 64)


@pytest.fixture(scope="module", autouse=True)
def serial():
    """The yardsticks compiled for one thread, which takes a tenth of the time."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("_numba_sum", "_interpolated"):
            loops = getattr(textbook, name).py_func
            patch.setattr(textbook, name, numba.njit(fastmath=True)(loops))
        yield


# Range profiles are interpolated linearly between 64 bins per cell: (π/64)²/8 = 3e-4 at the band's
# edges.
@pytest.mark.parametrize(
    ("image", "error"),
    [
        (numpy_sum, 1e-12),
        pytest.param(numba_sum, 1e-12, marks=pytest.mark.slow),  # compiles
        pytest.param(range_compressed, 1e-3, marks=pytest.mark.slow),
    ],
)
def test_yardsticks_agree_with_the_direct_sum(image, error):
    array = AntennaArray(qar50().tx_m[::31], qar50().rx_m[::31])
    samples = white_noise((64, *array.channels))
    points = np.random.default_rng(0).uniform([-0.1, -0.1, 0.25], [0.1, 0.1, 0.32], (20, 3))
    reference = direct_sum(samples, TONES_HZ, array, points)
    assert relative_error(image(samples, TONES_HZ, array, points), reference) < error


@pytest.mark.slow
def test_every_section_writes_its_rows(ran, monkeypatch):
    """On a small volume and few scatterers, in threads in place of processes."""
    spread_m = np.random.default_rng(0).uniform(-0.015, 0.015, (60, 3)) * [1, 1, 1 / 3]
    few = Scatterers(spread_m + [0, 0, 0.29], np.ones(60))
    monkeypatch.setattr(Inputs, "scatterers", property(lambda inputs: few))
    small = replace(
        QUICK,
        lateral=Axis(start_m=-0.02, stop_m=0.02, step_m=0.002),
        depth=Axis(start_m=0.28, stop_m=0.30, step_m=0.002),
        tolerances=(1e-3,),
        gemm_size=256,
        numpy_voxels=2,
        numba_voxels=4,
        growth=(1, 2),
        channels=(12, 24),
        tones=(16, 32),
    )
    monkeypatch.setattr(measure_engine, "QUICK", small)
    monkeypatch.setattr(volume_rows, "FRAMES", 2)
    monkeypatch.setattr(turns, "room", lambda: ThreadPoolExecutor(1))
    found = ran(measure_engine, "--quick")
    assert found["failures"] == {}
    rows = {(row["section"], row["method"]): row for row in found["rows"]}
    expected = {"seconds", "ratio_to_exact", "relative_error", "gflops", "peak_memory_mb"}
    assert all(expected <= set(row) for row in rows.values())
    assert all(row["met"] for row in rows.values() if "met" in row)
    assert {section for section, _ in rows} == {"volume", "3-FSK frame", "simulation"}
    assert rows["volume", "exact"]["relative_error"] < 1e-6
    assert len(found["growth"]) == 4 and all(len(one["seconds"]) == 2 for one in found["growth"])
