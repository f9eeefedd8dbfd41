"""Which examples property tests draw: HYPOTHESIS_PROFILE, or pytest's --hypothesis-profile, names
one of two profiles.

`fixed` draws the same ones every time and everywhere; `random` fresh ones, and more. Neither keeps
a database: nothing that lies on one machine changes what runs. A test says how many it draws
through `tests.strategies.examples`.
"""

import os

from hypothesis import settings

from tests.small_benchmark import small_bench, small_result
from tests.strategies import EXAMPLES

__all__ = ["small_bench", "small_result"]  # fixtures of all tests

settings.register_profile(
    "fixed", max_examples=EXAMPLES, derandomize=True, deadline=None, database=None
)
settings.register_profile(
    "random",
    max_examples=3 * EXAMPLES,
    derandomize=False,
    deadline=None,
    database=None,
    print_blob=True,
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))
