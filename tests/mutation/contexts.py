"""`python -m tests.mutation.contexts MAP.json TEST …`: the lines of the packages that each test
runs, and its seconds.

What a fixture of a module or a session runs counts for every test that uses it, not only for the
first one.
"""

from __future__ import annotations

import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import coverage
import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("radar", "calibration", "groundtruth", "bench")


class Contexts:
    """A plugin of pytest that tells coverage which test or shared fixture is at work."""

    def __init__(self) -> None:
        self.coverage = coverage.Coverage(
            data_file=None, source=[str(ROOT / p) for p in PACKAGES], config_file=False
        )
        self.seconds: dict[str, float] = {}
        self.users: defaultdict[str, list[str]] = defaultdict(list)  # of each shared fixture
        self.failed: set[str] = set()

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Note which tests use which shared fixtures."""
        for item in session.items:
            for name, definitions in item._fixtureinfo.name2fixturedefs.items():
                if definitions[-1].scope != "function":
                    self.users[_label(definitions[-1], name)].append(item.nodeid)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Time a test, under its own name."""
        self.coverage.switch_context(item.nodeid)
        start = time.monotonic()
        result = yield
        self.seconds[item.nodeid] = time.monotonic() - start
        self.coverage.switch_context("")
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef, request: pytest.FixtureRequest
    ) -> Iterator[None]:
        """Count what a shared fixture runs for all that use it."""
        if fixturedef.scope == "function":
            return (yield)
        self.coverage.switch_context(_label(fixturedef, fixturedef.argname))
        try:
            return (yield)
        finally:
            self.coverage.switch_context(request._pyfuncitem.nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note what fails: it can tell nothing about a mutant."""
        if report.failed:
            self.failed.add(report.nodeid)

    def map(self) -> dict[str, object]:
        """seconds of each test that passes, and by file and line the tests that run it."""
        tests = [test for test in self.seconds if test not in self.failed]
        number = {test: k for k, test in enumerate(tests)}
        data, lines = self.coverage.get_data(), {}
        for file in sorted(data.measured_files()):
            lines[str(Path(file).relative_to(ROOT))] = {
                line: sorted(
                    {
                        number[test]
                        for c in contexts
                        for test in self.users.get(c, [c])
                        if test in number
                    }
                )
                for line, contexts in data.contexts_by_lineno(file).items()
            }
        return {"tests": tests, "seconds": [self.seconds[test] for test in tests], "lines": lines}


def _label(definition: pytest.FixtureDef, name: str) -> str:
    return f"fixture {definition.baseid} {name}"


def main() -> int:
    """Run the tests and write the map."""
    target, *arguments = sys.argv[1:]
    contexts = Contexts()
    contexts.coverage.start()
    status = pytest.main(
        ["-m", "not slow", "-p", "no:cacheprovider", *arguments], plugins=[contexts]
    )
    contexts.coverage.stop()
    Path(target).parent.mkdir(parents=True, exist_ok=True)
    Path(target).write_text(json.dumps(contexts.map()))
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
