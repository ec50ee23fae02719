"""Agents that answer late, ahead, at the end, or what is no answer."""

import numpy as np
import pytest

from mtp_bench.env.rollouts import digest
from mtp_bench.judge import Limits
from tests.support.hostile import FRAMES, HURRIED, SLOW, Court

pytestmark = pytest.mark.usefixtures("light_fork_servers")

LATE = f"""
def act(self, observation):
    if self.frame == 2:
        time.sleep({SLOW})
    return self.honest(observation)
"""
ALWAYS_LATE = f"""
def act(self, observation):
    time.sleep({SLOW})
    return self.honest(observation)
"""
PATCHED = f"""
def act(self, observation):
    sleep = time.sleep
    time.time = time.monotonic = time.perf_counter = lambda: 0.0
    np.asarray = np.frombuffer = np.isfinite = lambda *_, **__: np.ones(3)
    sleep({SLOW} if self.frame == 2 else 0)
    return self.honest(observation)
"""
AT_THE_END = """
def act(self, observation):
    wire = sys.modules["mtp_bench_wire"]
    arrays_of, encode, header_of = wire.arrays_of, wire.encode, wire.header_of
    main = sys.modules.get("mtp_bench_child", sys.modules["__main__"])
    orders, answers = int(sys.argv[1]), int(sys.argv[2])
    asked = [sys._getframe(1).f_locals["header"]]
    actions = [self.honest(observation)]
    while len(asked) < self.given["frames"]:
        text, body = main._read(orders)
        asked.append(header_of(text))
        actions.append(self.honest(arrays_of(asked[-1], body)))
    for header, action in zip(asked[:-1], actions):
        main._write(answers, encode({"kind": "answer", "frame": header["frame"], "token": header["token"]}, action))
    sys._getframe(1).f_locals["header"].update(asked[-1])
    return actions[-1]
"""
AHEAD = """
def act(self, observation):
    encode = sys.modules["mtp_bench_wire"].encode
    header = dict(sys._getframe(1).f_locals["header"])
    action = self.honest(observation)
    for frame in (header["frame"], header["frame"] + 1):
        reply = {"kind": "answer", "frame": frame, "token": header["token"]}
        child = sys.modules.get("mtp_bench_child", sys.modules["__main__"])
        child._write(int(sys.argv[2]), encode(reply, action))
    time.sleep(0.1)
    return action
"""
TWICE = AHEAD.replace('(header["frame"], header["frame"] + 1)', '(header["frame"],)')
GARBAGE = """
def act(self, observation):
    os.write(int(sys.argv[2]), b"garbage of some length")
    return self.honest(observation)
"""
ENDLESS = """
def act(self, observation):
    PREFIX = sys.modules["mtp_bench_wire"].PREFIX
    os.write(int(sys.argv[2]), PREFIX.pack(2, 2**62) + b"{}")
    return self.honest(observation)
"""


def replaced(what: str) -> str:
    return f"""
def act(self, observation):
    action, rules = self.honest(observation), self._task
    {what}
    return action
"""


LATE_ANSWERS = {
    "one": (LATE, HURRIED), "all": (ALWAYS_LATE, HURRIED), "with patched clocks": (PATCHED, HURRIED),
    "together at the end": (AT_THE_END, HURRIED.model_copy(update={"first_frame": HURRIED.frame})),
}  # fmt: skip


@pytest.mark.parametrize(("trick", "limits"), LATE_ANSWERS.values(), ids=LATE_ANSWERS)
def test_a_late_answer_ends_the_scene(court: Court, trick: str, limits: Limits) -> None:
    run = court.run(trick, limits, frames=FRAMES)
    assert run.status != "finished" or run.malformed > 0
    assert run.rollout.object_start[-2] <= court.honest().object_start[2], "nothing counts after it"
    assert court.error(run.rollout) > court.error(court.honest())


FORGED = {"ahead": AHEAD, "twice": TWICE, "garbage": GARBAGE, "endless": ENDLESS}


@pytest.mark.parametrize("trick", FORGED.values(), ids=FORGED)
def test_what_was_not_asked_for_ends_the_scene(court: Court, trick: str) -> None:
    run = court.run(trick)
    assert run.status == "rejected"
    assert run.reason
    assert court.error(run.rollout) > court.error(court.honest())


MALFORMED = {
    "object arrays": "action['track_id'] = np.array([object()] * rules.tracks, dtype=object)",
    "huge arrays": "action['forecast'] = np.zeros(30_000_000)",
    "too many samples": "action['forecast'] = np.tile(action['forecast'], (1, 10, 1, 1))",
    "too many samples, weighted": (
        "action.update({name: np.repeat(action[name], 10, 1) for name in ('forecast', 'forecast_log_weight')})"
    ),
    "text": "action['object_class'] = 'car'",
    "ragged": "action['object_box'] = [[1.0], [1.0, 2.0]]",
    "no dict": "action = list(action.values())",
}


@pytest.mark.parametrize("what", MALFORMED.values(), ids=MALFORMED)
def test_what_is_no_answer_leaves_the_frame_unanswered(court: Court, what: str) -> None:
    run = court.run(replaced(what))
    assert (run.status, run.malformed, len(run.rollout.object_box)) == ("finished", FRAMES, 0)
    assert court.error(run.rollout) > court.error(court.honest())


NOT_FINITE = {
    "forecast": "action['forecast'][0] = np.nan",
    "one sample": "action['forecast'][0, -1, -1, 0] = np.inf",
    "track": "action['track_box'][0, 3] = np.nan",
    "object": "action['object_box'][0, 0] = -np.inf",
    "weight of a sample": "action['forecast_log_weight'][0, 0] = np.inf",
    "weight of a hypothesis": "action['hypothesis_log_weight'][0] = np.nan",
    "without a mask": "del action['object_valid']; action['object_box'][-1] = np.nan",
}


@pytest.mark.parametrize("what", NOT_FINITE.values(), ids=NOT_FINITE)
def test_one_number_that_is_not_finite_leaves_the_frame_unanswered(court: Court, what: str) -> None:
    run = court.run(replaced(f"if self.frame == 2: {what.replace('; ', chr(10) + '    if self.frame == 2: ')}"))
    objects, honest = np.diff(run.rollout.object_start), np.diff(court.honest().object_start)
    assert (run.status, run.malformed, objects[1], honest[1]) == ("finished", 1, 0, 3)
    assert np.delete(objects, 1).tolist() == np.delete(honest, 1).tolist()
    assert court.error(run.rollout) > court.error(court.honest())


UNUSED = {
    "rows": "action['object_box'][~action['object_valid'].astype(bool)] = np.nan; action['track_box'][-1] = np.inf",
    "samples": "action['forecast'][action['forecast_log_weight'] < -1e30] = np.nan",
    "hypotheses": "action['hypothesis_log_weight'][1:] = -np.inf",
}


def test_a_frame_without_objects_needs_no_forecasts(court: Court) -> None:
    nothing = "action['object_valid'] = np.zeros(rules.objects, dtype=bool); del action['forecast']"
    run = court.run(replaced(nothing))
    assert (run.status, run.malformed) == ("finished", 0)


@pytest.mark.parametrize("what", UNUSED.values(), ids=UNUSED)
def test_what_an_answer_does_not_use_may_be_anything(court: Court, what: str) -> None:
    run = court.run(replaced(what))
    assert (run.status, run.malformed) == ("finished", 0)
    assert np.array_equal(run.rollout.object_box, court.honest().object_box)
    assert np.array_equal(run.rollout.forecast, court.honest().forecast)


UNSOUND = {
    "out of range": "action['object_box'][:] = 1e30",
    "duplicate ids": "action['track_id'][:] = 3; action['object_valid'][:] = 1",
}


@pytest.mark.parametrize("what", UNSOUND.values(), ids=UNSOUND)
def test_unsound_rows_are_taken_out(court: Court, what: str) -> None:
    run = court.run(replaced(what))
    assert run.status == "finished"
    assert run.rollout.invalid.sum() > 0
    assert court.error(run.rollout) >= court.error(court.honest())


def test_the_seal_covers_every_answer(court: Court) -> None:
    once, again = court.run(replaced("pass")), court.run(replaced("pass"))
    assert (once.seal, digest(once.rollout)) == (again.seal, digest(again.rollout))
    assert court.run(replaced("action['object_box'] += 0.001")).seal != once.seal
    assert court.run(replaced("if self.frame == 4: action = None")).seal != once.seal
