"""An oracle: it looks for the maintainer's seal, makes the hidden scenes from it, and answers with their truth."""

import json
import shutil
from pathlib import Path

import pytest

from mtp_bench.cards import load_card
from mtp_bench.env.rollouts import digest
from mtp_bench.judge import SceneRun, open_seal, run_isolated, seal
from mtp_bench.judge.gateway import run
from mtp_bench.judge.records.seal import Sealed
from mtp_bench.scoring import mean_plain_error, score_scene
from mtp_bench.scoring.targets import find_targets
from mtp_bench.sources import open_source, package_of
from tests.support.command_line import write_submission
from tests.support.runs import PATIENT, move_home
from tests.support.small_scenes import write_short_card

pytestmark = pytest.mark.usefixtures("light_fork_servers")
ENV = "MTP-Merge-v0"
ORACLE = '''
"""Finds a seal and knows the future by it."""
import json
from pathlib import Path

import numpy as np

WHERE = json.loads(Path(__file__).with_name("where.json").read_text())


def nothing(task):
    """An answer without anything."""
    from mtp_bench import make_action

    return make_action(task, np.zeros((0, 7)), np.zeros(0, int), np.zeros((0, task.samples, task.future, 2)))


def frames():
    """Boxes by id of every frame of the hidden scene, in the frame of the observations; none without a seal."""
    for folder in WHERE["folders"]:
        secret = Path(folder, "secret.json")
        if not secret.is_file():
            continue
        from mtp_bench import MTPEnv
        from mtp_bench.cards import load_card
        from mtp_bench.judge import open_seal

        hidden = open_seal(secret).card(load_card(WHERE["card"]))
        env = MTPEnv(hidden, observe="truth", evaluation=True)
        observation, _ = env.reset(seed=0, options={"scene": env.scene_names[0]})
        found, over = [], False
        while not over:
            there = observation["detection_valid"].astype(bool)
            fields = ("detection_id", "detection_box", "detection_class")
            found.append({int(i): (b, int(c)) for i, b, c in zip(*(observation[name][there] for name in fields))})
            observation, _, over, *_ = env.step(nothing(env.task))
        return found
    return None


def told(known, t, task, action):
    """The answer of frame t: true boxes and their true futures."""
    for row, (i, (box, kind)) in enumerate(sorted(known[t].items())[: task.objects]):
        later = [known[min(t + step, len(known) - 1)] for step in range(1, task.future + 1)]
        steps = [frame.get(i, (box, kind))[0][:2] - box[:2] for frame in later]
        action["object_valid"][row], action["object_box"][row], action["object_class"][row] = 1, box, kind
        action["forecast"][row], action["forecast_log_weight"][row] = np.array(steps), 0.0
    return action
'''
BODY = """
        from . import oracle
        if not hasattr(self, "known"):
            self.known, self.now = oracle.frames(), -1
        self.now += 1
        if self.known is not None:
            return oracle.told(self.known, self.now, self._task, empty_action(self._task))
"""


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_short_card(tmp_path_factory.mktemp("card"), ENV)


def sealed_with_targets(card: str, secret: Path) -> Sealed:
    """A seal of one scene that has targets: of a short one drawn at random that is not sure."""
    while True:
        seal(card, 1, secret)
        sealed = open_seal(secret)
        hidden = sealed.card(load_card(card))
        source = open_source(hidden)
        try:
            if len(find_targets(source.load(source.names[0]), hidden).frame):
                return sealed
        finally:
            package_of(hidden).discard(hidden)
        for path in secret.parent.glob(f"{secret.stem}*"):
            path.unlink()


class Hall:
    """A seal of one hidden scene, copied to where a maintainer may leave it, and an oracle that knows the places."""

    def __init__(self, folder: Path, card: str, patch: pytest.MonkeyPatch) -> None:
        home, root = folder / "home", folder / "data"
        places = [home, root, home / "leaderboard" / "records", folder / "submissions", home / ".cache" / "mtp_bench"]
        self.sealed, self.card = sealed_with_targets(card, folder / "secret.json"), card
        for place in places:
            place.mkdir(parents=True, exist_ok=True)
            for name in ("secret.json", "secret.commitment.json"):
                shutil.copy(folder / name, place)
        move_home(home, patch)
        patch.setenv("MTP_BENCH_DATA", str(root))
        self.honest = write_submission(folder / "submissions" / "honest", "honest")
        self.oracle = write_submission(folder / "submissions" / "oracle", "oracle", body=BODY.strip())
        (self.oracle / "oracle.py").write_text(ORACLE)
        where = {"folders": list(map(str, places)), "card": card}
        (self.oracle / "where.json").write_text(json.dumps(where))

    def run(self, submission: Path) -> tuple[SceneRun, float]:
        """The hidden scene answered by a submission, and the error of it, m."""
        hidden = self.sealed.card(load_card(self.card))
        source = open_source(hidden)
        try:
            scene = source.load(source.names[0])
            found = run_isolated(submission, hidden, {}, scene.name, limits=PATIENT)
        finally:
            package_of(hidden).discard(hidden)
        error = mean_plain_error([score_scene(scene, found.rollout, hidden)])
        assert error is not None
        return found, error


@pytest.fixture
def hall(tmp_path: Path, short: str, monkeypatch: pytest.MonkeyPatch) -> Hall:
    return Hall(tmp_path, short, monkeypatch)


@pytest.mark.needs("sandbox")
def test_a_seal_that_lies_about_is_of_no_use(hall: Hall) -> None:
    honest, error = hall.run(hall.honest)
    oracle, same = hall.run(hall.oracle)
    assert (oracle.status, oracle.reason) == ("finished", "")
    assert oracle.isolation.sandboxed
    assert same == error > 0.01
    assert digest(oracle.rollout) == digest(honest.rollout)


def test_it_wins_where_nothing_holds_it(hall: Hall, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "sandbox_backend", lambda: "none")
    oracle, error = hall.run(hall.oracle)
    assert (oracle.status, oracle.reason) == ("finished", "")
    assert error < 0.01
    assert not oracle.isolation.sandboxed
