"""Which examples property tests draw: HYPOTHESIS_PROFILE, or pytest's --hypothesis-profile, names
one of three profiles.

`fixed` draws the same ones every time and everywhere; `random` and `fuzz` fresh ones, three and a
hundred times as many. None keeps a database: nothing that lies on one machine changes what runs. A
test says how many it draws through `tests.strategies.examples`.

The option --update-golden writes the golden files anew (tests/golden_files.py).
"""

import os

# Two processes share the cores. Threads of BLAS spin while they wait for one: the tests of balls
# took half as much processor time again. BLAS reads it as NumPy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

from tests.golden_files import golden
from tests.small_benchmark import small_bench, small_result
from tests.strategies import EXAMPLES

__all__ = ["golden", "small_bench", "small_result"]  # fixtures of all tests


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that renews golden files."""
    parser.addoption("--update-golden", action="store_true", help="write tests/golden anew")


settings.register_profile(
    "fixed", max_examples=EXAMPLES, derandomize=True, deadline=None, database=None
)
for profile, factor in (("random", 3), ("fuzz", 100)):
    settings.register_profile(
        profile,
        max_examples=factor * EXAMPLES,
        derandomize=False,
        deadline=None,
        database=None,
        print_blob=True,
    )
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))
