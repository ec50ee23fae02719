"""Agents as forks of a process that has loaded the library: as shut in as one that loads it itself, and as fresh."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from mtp_bench.env.rollouts import digest
from mtp_bench.gateway import SceneRun, mechanism, stems
from mtp_bench.gateway.image import image_of
from mtp_bench.gateway.layout import layout_for
from mtp_bench.gateway.stems import StemError, can_stem, stem_of, uproot
from mtp_bench.submission import load_submission
from tests.support.hostile import HONEST, Court, submission

pytestmark = pytest.mark.skipif(mechanism.mechanism() != "bubblewrap", reason="a stem needs bubblewrap")

ASKS = """
def act(self, observation):
    if self.frame == 0:
        {asks}
        print(said)
        raise RuntimeError(said)
    return self.honest(observation)
"""


def said(court: Court, asks: str) -> str:
    """What an agent finds out about itself."""
    run = court.run(ASKS.format(asks=asks))
    assert run.status == "crashed"
    return run.reason.split("RuntimeError: ")[1]


@pytest.fixture(autouse=True)
def _with_a_stem(court: Court) -> Iterator[None]:
    """A library below /tmp cannot be shown to forks: then nothing here is tested."""
    if not can_stem(layout_for(image_of(load_submission(submission(court.folder / "any")), "MTP-X-v0"), None)):
        pytest.skip("the library is in /tmp")
    yield
    uproot()


def forks_made(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers of the forks from here on."""
    made: list[int] = []
    grow = stems.Stem.grow

    def counted(stem: stems.Stem, descriptors: list[int], space: int) -> int:
        made.append(grow(stem, descriptors, space))
        return made[-1]

    monkeypatch.setattr(stems.Stem, "grow", counted)
    return made


def test_a_fork_answers_as_a_process_of_its_own(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    made = forks_made(monkeypatch)
    grown = court.run(HONEST)
    assert len(made) == 1
    monkeypatch.setattr("mtp_bench.gateway.process.stem_of", lambda _: None)
    alone = court.again()
    assert len(made) == 1
    assert (grown.status, grown.seal, digest(grown.rollout)) == (alone.status, alone.seal, digest(alone.rollout))
    assert grown.isolation == alone.isolation


def test_one_stem_serves_a_submission(court: Court) -> None:
    court.run(HONEST)
    first = stems._planted[0]
    court.again()
    assert stems._planted == [first]
    court.run("def act(self, observation):\n    return self.honest(observation)  # another submission")
    assert stems._planted != [first]
    assert not first.lives


HELD = {
    "no rights": ("dict(l.split(':', 1) for l in open('/proc/self/status'))", "CapEff", "0000000000000000"),
    "none to come": ("dict(l.split(':', 1) for l in open('/proc/self/status'))", "CapBnd", "0000000000000000"),
    "no new ones": ("dict(l.split(':', 1) for l in open('/proc/self/status'))", "NoNewPrivs", "1"),
    "a filter": ("dict(l.split(':', 1) for l in open('/proc/self/status'))", "Seccomp", "2"),
}


@pytest.mark.parametrize(("table", "key", "expected"), HELD.values(), ids=HELD)
def test_a_fork_is_held(court: Court, table: str, key: str, expected: str) -> None:
    assert said(court, f"said = {table}[{key!r}].strip()") == expected


FACTS = {
    "it is the first of its processes": ("(os.getpid(), os.getppid())", "(1, 0)"),
    "it sees no other": ("sorted(n for n in os.listdir('/proc') if n.isdigit())", "['1']"),
    "it holds two pipes and three streams": ("len(os.listdir('/proc/self/fd')) - 1", "5"),
    "no socket": (
        "[n for n in os.listdir('/proc/self/fd') if 'socket' in os.path.realpath(f'/proc/self/fd/{n}')]", "[]",
    ),
    "its folder is empty": ("sorted(set(os.listdir('/tmp')) - {'kernels'})", "[]"),
    "no memory that forks share": (
        "[l for l in open('/proc/self/maps') if l.split()[1][1] == 'w' and l.split()[1][3] == 's']", "[]",
    ),
    "no network": ("[l.split(':')[0].strip() for l in open('/proc/net/dev')][2:]", "['lo']"),
    "what started it is not told": ("len(sys.argv)", "3"),
}  # fmt: skip


@pytest.mark.parametrize(("asks", "expected"), FACTS.values(), ids=FACTS)
def test_what_a_fork_sees(court: Court, asks: str, expected: str) -> None:
    assert said(court, f"said = str({asks})") == expected


LEAVES = {
    "a file": ("open('/tmp/note', 'w').write('x')", "os.path.exists('/tmp/note')"),
    "a module": ("sys.modules['note'] = sys", "'note' in sys.modules"),
    "an attribute of the library": ("import mtp_bench; mtp_bench.note = 1", "hasattr(__import__('mtp_bench'), 'note')"),
    "the environment": ("os.environ['NOTE'] = '1'", "'NOTE' in os.environ"),
    "a name": ("ctypes.CDLL(None).prctl(15, b'note', 0, 0, 0)", "'note' in open('/proc/self/comm').read()"),
    "a mode of its input": (
        "import fcntl; fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_NONBLOCK)",
        "bool(__import__('fcntl').fcntl(0, 3) & os.O_NONBLOCK)",
    ),
}


@pytest.mark.parametrize(("leaves", "finds"), LEAVES.values(), ids=LEAVES)
def test_nothing_survives_a_scene(court: Court, leaves: str, finds: str) -> None:
    """The same submission twice, so the same stem: what it finds at its first frame, then leaves."""
    trick = f"""
def act(self, observation):
    found = {finds}
    {leaves}
    raise RuntimeError(f"{{found}} {{{finds}}}")
"""
    runs: list[SceneRun] = [court.run(trick)]
    first = stems._planted[0]
    runs.append(court.again())
    assert stems._planted == [first]
    assert [run.reason.split("RuntimeError: ")[1] for run in runs] == ["False True", "False True"]


def test_unseeded_draws_differ_between_agents(court: Court) -> None:
    asks = "said = str(np.random.random()) + ' ' + str(__import__('random').random())"
    one, first = said(court, asks).split(), stems._planted[0]
    other = court.again().reason.split("RuntimeError: ")[1].split()
    assert stems._planted == [first]
    assert one[0] != other[0]
    assert one[1] != other[1]


def test_a_stem_that_died_is_planted_again(court: Court) -> None:
    court.run(HONEST)
    os.killpg(stems._planted[0]._process.pid, signal.SIGKILL)
    stems._planted[0]._process.wait()
    assert court.again().status == "finished"


def test_without_a_fork_it_starts_alone(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(stem: stems.Stem, descriptors: list[int], space: int) -> int:
        raise StemError("no")

    monkeypatch.setattr(stems.Stem, "grow", refuse)
    assert court.run(HONEST).status == "finished"


def test_no_stem_where_its_folder_would_hide_what_is_shown(court: Court) -> None:
    layout = layout_for(image_of(load_submission(submission(court.folder / "mine")), "MTP-X-v0"), None)
    below = replace(layout, shown=(*layout.shown, (str(Path.home()), "/tmp/library")))
    assert can_stem(layout)
    assert not can_stem(below)
    assert stem_of(below) is None
