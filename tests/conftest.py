"""Fixtures of all tests, their order, and the markers ``data`` and ``needs`` of those that cannot run everywhere."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # small matrices: threads would only stand in each other's way
os.environ.setdefault("MTP_BENCH_QUIET", "1")  # how long a command takes depends on the machine

import gc
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from mtp_bench.core.parallel import cores
from tests.support.command_line import CommandLine
from tests.support.costs import Costs, leave_out_slow
from tests.support.leaderboards import listed, make_key, make_leaderboard
from tests.support.programs import require_program
from tests.support.small_scenes import write_card, write_kitti
from tests.support.stored_runs import write_events_run

VARIABLE = "MTP_BENCH_DATA"
LONGEST = ("test_examples.py", "test_site.py")  # a minute each
REPOSITORY = Path(__file__).resolve().parent.parent
_deselected = pytest.StashKey[int]()

# No test times anything: on a busy machine an example may take as long as it likes.
settings.register_profile("any machine", max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--list-skipped", type=Path, help="file for the ids of skipped tests; `pytest @FILE` runs them")
    parser.addoption("--list-costs", type=Path, help="file for the CPU seconds of each test")
    parser.addoption("--quick", action="store_true", help="leave out the slow tests, those of tests/slow.txt")


def pytest_configure(config: pytest.Config) -> None:
    costs = config.getoption("--list-costs")
    if costs is not None:
        config.pluginmanager.register(Costs(costs))
    root = os.environ.get(VARIABLE)
    if root and not Path(root).is_dir():
        raise pytest.UsageError(f"{VARIABLE} is {root!r}, expected an existing folder; unset it to run without data")
    if root:
        os.environ[VARIABLE] = str(Path(root).resolve())  # tests may change the working directory


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Number of test processes: one per core and one more, as each waits for programs a fifth of its time."""
    return cores() + 1


def pytest_report_header(config: pytest.Config) -> str:
    return f"{VARIABLE}: {os.environ.get(VARIABLE) or 'not set, tests on real data are deselected'}"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if os.environ.get("PYTEST_XDIST_WORKER"):
        take_packages_in_turn(items)
    if config.getoption("--quick"):
        leave_out_slow(config, items)
    if os.environ.get(VARIABLE):
        return
    marked = [item for item in items if item.get_closest_marker("data")]
    if marked:
        config.hook.pytest_deselected(items=marked)
        items[:] = [item for item in items if not item.get_closest_marker("data")]
    config.stash[_deselected] = len(marked)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test whose marker ``needs`` names a missing program."""
    for marker in item.iter_markers("needs"):
        require_program(marker.args[0])


def pytest_collection_finish() -> None:
    """Leave out of garbage collection the modules and items, which stay until the end."""
    gc.freeze()


def take_packages_in_turn(items: list[pytest.Item]) -> None:
    """Order tests by file: the longest, then one file of each package, then the next of each.

    Files that mostly wait lie in a few packages: side by side they leave cores idle. So does a long file at the end.
    """
    files = dict.fromkeys(item.path for item in items)
    taken: Counter[Path] = Counter()
    turn = {}
    for file in files:
        turn[file] = taken[file.parent]
        taken[file.parent] += 1
    items.sort(key=lambda item: (item.path.name not in LONGEST, turn[item.path]))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Write one line per reason for which tests did not run."""
    skipped = terminalreporter.stats.get("skipped", [])
    for reason, count in Counter(skip_reason(report) for report in skipped).most_common():
        tests = "test" if count == 1 else "tests"
        terminalreporter.write_line(f"skipped {count} {tests}: {reason}", yellow=True)
    deselected = config.stash.get(_deselected, 0)
    if deselected:
        said = f"{deselected} tests need real data and did not run: set {VARIABLE} to its folder"
        terminalreporter.write_line(said, yellow=True)
    listed_in = config.getoption("--list-skipped")
    if listed_in is not None:
        listed_in.parent.mkdir(parents=True, exist_ok=True)
        listed_in.write_text("".join(f"{report.nodeid}\n" for report in skipped))


def skip_reason(report: pytest.TestReport) -> str:
    """Return the reason that a skipped test gives."""
    assert isinstance(report.longrepr, tuple)
    return report.longrepr[2].removeprefix("Skipped: ")


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The data root; a test that asks for it carries the marker ``data``."""
    return Path(os.environ[VARIABLE])


@pytest.fixture(scope="session")
def repository() -> Path:
    return REPOSITORY


@pytest.fixture(scope="session")
def kitti(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A data root with the tiny sequences of `small_scenes`; tests that break files make their own."""
    return write_kitti(tmp_path_factory.mktemp("data"))


@pytest.fixture(scope="session")
def card(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Path of a card for them."""
    return write_card(tmp_path_factory.mktemp("card"))


@pytest.fixture
def known(card: str, kitti: str) -> list[str]:
    """Options that every command on a run of the small card needs."""
    return ["--env", card, "--data", kitti]


@pytest.fixture(scope="session")
def events_run(tmp_path_factory: pytest.TempPathFactory, card: str, kitti: str) -> Path:
    return write_events_run(tmp_path_factory.mktemp("runs") / "drawn", card, kitti)


@pytest.fixture(scope="session", autouse=True)
def in_one_process() -> Iterator[None]:
    """Commands do their work in this process, as tests run beside each other already; with ``--jobs`` in several."""
    with pytest.MonkeyPatch.context() as patch:
        for command in ("options", "check"):
            patch.setattr(f"mtp_bench.commands.{command}.cores", lambda: 1)
        yield


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """One folder for all processes of this session, apart from the user's cache."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base) / "cache"
    folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        from mtp_bench.tracking.kernels.cache import cache_folder  # imports Numba

        patch.setenv("NUMBA_CACHE_DIR", str(cache_folder()))  # else each session compiled the kernels anew
        patch.setenv("MTP_BENCH_CACHE", str(folder))
        yield folder


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile kernels before several test processes start (pytest-xdist); `make test` has done so already."""
    if getattr(session.config.option, "numprocesses", None) and "MAKELEVEL" not in os.environ:
        compile_kernels()


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """Compile kernels before the first test, whose output would show the line about it."""
    compile_kernels()


def compile_kernels() -> None:
    """Let the tracker compile what it uses."""
    from mtp_bench import load_submission
    from tests.support.tracking_scenes import frame, kitti_task, observation

    agent = load_submission("mtp").build(kitti_task())
    agent.reset(kitti_task())
    for _ in range(2):
        agent.act(observation(frame((0.0, 0.0, 0), (1.0, 0.0, 0))))


@pytest.fixture(scope="session", autouse=True)
def no_viewer() -> None:
    """No test opens a window: rerun has an active recording, which keeps nothing."""
    from mtp_bench.viz.rerun.sdk import rr

    rr.RecordingStream("tests", make_default=True, send_properties=False).save(os.devnull)


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> CommandLine:
    return CommandLine(capsys)


@pytest.fixture(scope="session")
def key(tmp_path_factory: pytest.TempPathFactory) -> Path:
    require_program("ssh-keygen")
    return make_key(tmp_path_factory.mktemp("keys") / "tester")


@pytest.fixture
def leaderboard(key: Path, tmp_path: Path) -> Path:
    return make_leaderboard(tmp_path / "leaderboard", listed(key))


@pytest.fixture(scope="session")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A submission that takes its trick as a parameter."""
    from tests.support.hostile import submission  # it imports much

    return submission(tmp_path_factory.mktemp("hostile") / "hostile")


@pytest.fixture
def remembered_weights(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Event weights of a card, data and scenes are made once, but of a card that ships: there they may be frozen."""
    from tests.support.runs import remembered_reference  # it imports much

    if "shipped" not in request.fixturenames:
        for module in ("running.stored", "running.evaluation", "judge.records.submitting"):
            monkeypatch.setattr(f"mtp_bench.{module}.reference_for", remembered_reference)


@pytest.fixture
def few_event_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Event weights that do not ship come from six runs, one of each kind: for tests of something else."""
    from mtp_bench.running.reference import make_reference

    monkeypatch.setattr(make_reference, "__defaults__", (*(make_reference.__defaults__ or ())[:-1], range(6)))


@pytest.fixture
def light_fork_servers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork servers load what every agent needs without the trackers: half a second less for each submission."""
    monkeypatch.setattr("mtp_bench.judge.gateway.fork_server.LOADED", ("mtp_bench.agent.loader",))
