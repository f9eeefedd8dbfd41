"""What property tests share."""

from hypothesis import settings

EXAMPLES = (
    100  # of hypothesis' own default: a profile with twice as many doubles those of every test
)


def examples(count: int) -> settings:
    """Settings of a test that draws `count` examples, times what the profile asks for (see
    tests/conftest.py)."""
    return settings(max_examples=count * settings.default.max_examples // EXAMPLES)
