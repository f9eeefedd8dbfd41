"""The section on causes draws and tables what causes.csv and reliability.csv say; older results
have no such part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handbench.bench import results
from handbench.radar.data.depthmap import DepthMap
from handbench.reports.page import html, sections
from tests.bench.evaluation.explained import Scored, explain
from tests.reports.synthetic_result import METHODS, write_synthetic

SIGMAS_M = {"2fsk": 6e-3, "3fsk": 1.5e-3, "broadband": None}


def tell(folder: Path, methods: tuple[str, ...]) -> results.Result:
    """A synthetic result, to which the causes of some methods' errors were added."""
    old = results.load(folder)
    assert not len(old.causes) and not len(old.reliability)
    maps, rng = [], np.random.default_rng(4)
    for capture in old.scored()[:2]:
        for reference in capture.references:
            for method in methods:
                sigma_m = SIGMAS_M[method]
                errors = old.errors(capture.name, method, reference)
                level_db = rng.uniform(-14, 0, errors.error_m.shape)
                sigma = None if sigma_m is None else np.full(errors.error_m.shape, sigma_m)
                z_m = errors.reference_z_m + errors.error_m
                maps.append(
                    Scored(
                        method,
                        reference,
                        DepthMap(errors.x_m, errors.y_m, z_m, level_db, method, {}, sigma),
                        errors,
                    )
                )
    results.write_tables(folder, **explain(maps))
    return results.load(folder)


@pytest.mark.slow
def test_the_page_has_the_section_and_that_of_an_older_result_does_not(result_folder, tmp_path):
    small = write_synthetic(
        tmp_path / "r", ("B",), {"3fsk": METHODS["3fsk"]}, ("truth",), step_m=6e-3
    )
    html.build(tell(small, ("3fsk",)).folder, tmp_path / "new")
    assert 'id="causes"' in (tmp_path / "new" / "index.html").read_text("utf-8")
    assert {"causes__truth.png", "reliability.pdf"} <= {
        p.name for p in (tmp_path / "new" / "figures").iterdir()
    }
    assert sections.causes(results.load(result_folder), tmp_path) is None
