"""`pytest --processor N`: the N tests and the N modules that took most processor, their own and their children's.

`--durations` counts waiting, which costs nothing beside other lanes. Of children only those count that a test has
waited for.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Generator
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from typing import Final, cast

import pytest

_KEY: Final = "processor"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--processor", type=int, default=0, metavar="N", help="print the N dearest tests in processor time"
    )


class Processor:
    """Notes in each report what its phase took, and sums the reports of all workers."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._taken: dict[str, tuple[float, float]] = defaultdict(lambda: (0.0, 0.0))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        # A phase goes on into the next, so that nothing between two is lost.
        item.stash[_BEGAN] = _used()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        began, now = item.stash[_BEGAN], _used()
        item.stash[_BEGAN] = now
        report.user_properties.append((_KEY, (now[0] - began[0], now[1] - began[1])))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        for name, value in report.user_properties:
            if name == _KEY:
                more = cast(tuple[float, float], value)
                own, children = self._taken[report.nodeid]
                self._taken[report.nodeid] = own + more[0], children + more[1]

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        modules: dict[str, tuple[float, float]] = defaultdict(lambda: (0.0, 0.0))
        for test, (own, children) in self._taken.items():
            module = test.partition("::")[0]
            modules[module] = modules[module][0] + own, modules[module][1] + children
        for title, taken in (("modules", modules), ("tests", self._taken)):
            terminalreporter.section(f"processor of {title}: own and children's [s]")
            dearest = sorted(taken.items(), key=lambda each: -sum(each[1]))[: self._count]
            for name, (own, children) in dearest:
                terminalreporter.write_line(f"{own:8.2f} {children:8.2f} {name}")
            own, children = (sum(each[k] for each in taken.values()) for k in (0, 1))
            terminalreporter.write_line(f"{own:8.2f} {children:8.2f} of all {len(taken)}")


_BEGAN: Final = pytest.StashKey[tuple[float, float]]()


def _used() -> tuple[float, float]:
    own, children = getrusage(RUSAGE_SELF), getrusage(RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime


def pytest_configure(config: pytest.Config) -> None:
    count: int = config.getoption("--processor")
    if count:
        config.pluginmanager.register(Processor(count), "processor")
