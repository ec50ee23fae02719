"""What each test costs in CPU seconds, and the list of the slow ones, which `make quick` leaves out.

The cost of a test is what it takes alone: its own call, its fixtures, and those of its module. Fixtures of the whole session
are everybody's. A parametrised test counts with its dearest case.
"""

import os
from collections import defaultdict
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any

import pytest

SLOW = Path(__file__).resolve().parent.parent / "slow.txt"
SLOW_SECONDS = 0.3
_call_seconds = pytest.StashKey[float]()


def cpu_seconds() -> float:
    """CPU seconds of this process and of its children that have ended."""
    return sum(os.times()[:4])


class Costs:
    """A plugin that writes "seconds id" for every test function to a file, the dearest first.

    With pytest-xdist the test processes measure, and their reports bring the seconds to the one that writes.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._fixture_seconds: dict[Any, float] = {}
        self._seconds: dict[str, float] = defaultdict(float)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Generator[None, Any, Any]:
        start = cpu_seconds()
        try:
            return (yield)
        finally:
            self._fixture_seconds[fixturedef] = cpu_seconds() - start

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, Any, Any]:
        start = cpu_seconds()
        try:
            return (yield)
        finally:
            item.stash[_call_seconds] = cpu_seconds() - start

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Generator[None, Any, Any]:
        report = yield
        if report.when == "call":
            report.cpu_seconds = item.stash.get(_call_seconds, 0.0) + sum(self._of_fixtures(item))
        return report

    def _of_fixtures(self, item: Any) -> Iterable[float]:
        for definitions in item._fixtureinfo.name2fixturedefs.values():
            for definition in definitions:
                if definition.scope != "session":
                    yield self._fixture_seconds.get(definition, 0.0)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        seconds = getattr(report, "cpu_seconds", None)
        if seconds is not None:
            name = report.nodeid.partition("[")[0]
            self._seconds[name] = max(self._seconds[name], seconds)

    def pytest_terminal_summary(self) -> None:
        by_cost = sorted(self._seconds.items(), key=lambda pair: (-pair[1], pair[0]))
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._path.write_text("".join(f"{seconds:.2f} {name}\n" for name, seconds in by_cost))


def write_slow(costs: Path) -> None:
    """Write the list of slow tests of a file of costs."""
    pairs = [line.split() for line in costs.read_text().splitlines()]
    slow = sorted(name for seconds, name in pairs if float(seconds) > SLOW_SECONDS)
    SLOW.write_text("".join(f"{name}\n" for name in slow))


def leave_out_slow(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the tests of the list."""
    slow = set(SLOW.read_text().splitlines())
    left_out = [item for item in items if item.nodeid.partition("[")[0] in slow]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item.nodeid.partition("[")[0] not in slow]


if __name__ == "__main__":
    import sys

    write_slow(Path(sys.argv[1]))
