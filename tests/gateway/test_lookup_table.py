"""An agent that has seen the scene before: it knows the futures by heart, until the world is turned."""

import numpy as np
import pytest

from mtp_bench import MTPEnv
from mtp_bench.judge import run_isolated, submit, verify
from mtp_bench.running.options import RunOptions
from mtp_bench.running.playing import derived_seed
from tests.support.hostile import FRAMES, QUICK, SCENE, Court, submission
from tests.support.small_scenes import empty_action

TABLE = """
def act(self, observation):
    action = self.honest(observation)
    with np.load(Path(__file__).with_name("table.npz")) as table:
        key = observation["detection_box"].round(2).tobytes().hex()
        if key in table:
            action["forecast"][:3] = table[key]
    return action
"""


def seen(court: Court) -> dict[str, object]:
    """The futures of the three objects, from what was detected later; in the frame of reference of the first visit."""
    env = MTPEnv(court.card, court.data, evaluation=True)
    observation, _ = env.reset(seed=derived_seed(0, SCENE, "env"), options={"scene": SCENE})
    frames = []
    for _ in range(FRAMES):
        frames.append(observation["detection_box"].copy())
        observation, *_ = env.step(empty_action(env.task))
    steps = np.arange(1, env.task.future + 1)
    table: dict[str, object] = {}
    for t, now in enumerate(frames[:3]):
        last = frames[2][:3, :2] - frames[1][:3, :2]  # nothing is seen in frames 3 and 4, but all goes on as it did
        future = last[:, None, :] * steps[None, :, None]
        table[now.round(2).tobytes().hex()] = np.repeat(future[:, None], env.task.samples, axis=1)
        assert t < FRAMES
    return table


def test_a_lookup_table_helps_only_in_the_world_that_it_knows(court: Court) -> None:
    folder = submission(court.folder / "hostile", TABLE)
    np.savez(folder / "table.npz", **seen(court))  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
    errors = []
    for keywords, seed in (({}, 0), ({"rigid_motion": True}, 0), ({"rigid_motion": True}, 1)):
        run = run_isolated(folder, court.card, {"data": court.data, **keywords}, SCENE, seed, limits=QUICK)
        assert run.status == "finished", run.reason
        errors.append(court.error(run.rollout))
    honest = court.error(court.honest())
    assert errors[0] < honest
    np.testing.assert_allclose(errors[1:], honest, rtol=1e-2)


CHEAT = """
def act(self, observation):
    with np.load(Path(__file__).with_name("table.npz")) as table:
        known = observation["ego_pose"].round(2).tobytes().hex() in table
    action = self.honest(observation)
    return action if known else empty_action(self._task)
"""


def poses(court: Court, seeds: int) -> dict[str, object]:
    """Where the ego vehicle is in every frame under every motion of the first seeds: what a cheat can compute."""
    env = MTPEnv(court.card, court.data, evaluation=True, rigid_motion=True)
    table: dict[str, object] = {}
    for scene in env.scene_names:
        for seed in range(seeds):
            observation, _ = env.reset(seed=derived_seed(seed, scene, "env"), options={"scene": scene})
            over = False
            while not over:
                table[observation["ego_pose"].round(2).tobytes().hex()] = np.ones(1)
                observation, _, over, *_ = env.step(empty_action(env.task))
    return table


@pytest.mark.needs("sandbox")
def test_a_table_made_for_the_public_motions_does_not_survive_a_secret_one(court: Court) -> None:
    folder = submission(court.folder / "hostile", CHEAT)
    np.savez(folder / "table.npz", **poses(court, 2))  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
    options = RunOptions(court.data, seeds=(0, 1))
    made = submit(folder, court.card, options, court.folder / "records")
    path = court.folder / "records" / f"{made.env.id}.json"
    assert made.row.coverage is not None
    assert made.row.coverage > 0.5, "the cheat works on what is public"
    assert verify(path, options, court.card).holds
    checked = verify(path, options, court.card, submission=folder, rerun=True)
    assert checked.level == "scored"
    (difference,) = checked.differences
    assert difference.what == "error of all under another motion"
    assert difference.found == pytest.approx(2.0)  # it says nothing
