"""Every way to break the contract takes out the row and counts it; nothing raises and nothing is gained."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as st_np

from mtp_bench.agent.action import ROW_KINDS
from mtp_bench.agent.checks import check_action
from mtp_bench.env.rollouts import record_action
from tests.support.small_scenes import Action, decode, empty_action, full_action, task

TASK = task()
Break = Callable[[Action], Any]


def put(key: str, index: Any, value: Any) -> Break:
    return lambda action: action[key].__setitem__(index, value)


def swap(key: str, value: Any) -> Break:
    return lambda action: action.__setitem__(key, value)


def cast(key: str, dtype: Any) -> Break:
    return lambda action: action.__setitem__(key, action[key].astype(dtype))


def drop(key: str) -> Break:
    return lambda action: action.pop(key)


def both(first: Break, second: Break) -> Break:
    return lambda action: (first(action), second(action))


class Case(NamedTuple):
    """A change of an action that is sound, and what is left of it."""

    change: Break
    said: str = ""  # what is said of it, as "field: reason"
    ids: tuple[int, ...] = (10, 11, 12, 12)
    objects: int = 2
    hypotheses: int = 2
    counted: tuple[int, int, int] = (0, 0, 0)  # tracks, hypotheses, objects


def track(change: Break, said: str) -> Case:
    """Track 11 is taken out."""
    return Case(change, said, (10, 12, 12), counted=(1, 0, 0))


def no_track(change: Break, said: str, counted: int = 4) -> Case:
    return Case(change, said, (), counted=(counted, 0, 0))


def hypothesis(value: float, said: str = "", counted: int = 0) -> Case:
    """The first hypothesis has this log-weight: it is not there."""
    ids, change = (10, 11, 12), put("hypothesis_log_weight", 0, value)
    return Case(change, said or "track_valid: in no hypothesis, so unused", ids, 2, 1, (0, counted, 0))


def thing(change: Break, said: str) -> Case:
    """One object is taken out."""
    return Case(change, said, objects=1, counted=(0, 0, 1))


def no_object(change: Break, said: str, counted: int = 2) -> Case:
    return Case(change, said, objects=0, counted=(0, 0, counted))


def no_hypothesis(change: Break, said: str, counted: int) -> Case:
    return Case(change, said, (), hypotheses=0, counted=(0, counted, 0))


TURNED = np.ones((5, 3), dtype=bool)
FAR, BROKEN = "forecast: too far", "hypothesis_log_weight: NaN or +inf"
UNUSED = "track_valid: in no hypothesis, so unused"
CASES: dict[str, Case] = {
    "nothing broken": Case(lambda action: None),
    "NaN in a track": track(put("track_box", (1, 3), np.nan), "track_box: not finite"),
    "track far away": track(put("track_box", (1, 1), 1.1e5), "track_box: out of range"),
    "track without width": track(put("track_box", (1, 5), 0.0), "track_box: out of range"),
    "negative id": track(put("track_id", 1, -1), "track_id: out of range"),
    "id beyond 31 bits": track(put("track_id", 1, 2**31), "track_id: out of range"),
    "class of a track unknown": track(put("track_class", 1, 2), "track_class: unknown"),
    "no class for tracks": Case(drop("track_class")),
    "id twice in one hypothesis": Case(
        put("hypothesis_member", (0, 3), 1), "track_id: twice in one hypothesis", (10, 11), counted=(2, 0, 0)
    ),
    "one id for all": no_track(put("track_id", slice(0, 3), 12), "track_id: twice in one hypothesis"),
    "broken namesake does not count": Case(
        both(put("hypothesis_member", (0, 3), 1), put("track_box", (3, 0), np.nan)),
        "track_box: not finite",
        (10, 11, 12),
        counted=(1, 0, 0),
    ),
    "namesake in an absent hypothesis": Case(put("hypothesis_member", (2, slice(None)), 1)),
    "track in no hypothesis": Case(put("hypothesis_member", (slice(None), 1), 0), UNUSED, (10, 12, 12)),
    "hypothesis weight NaN": hypothesis(np.nan, BROKEN, 1),
    "hypothesis absent, -inf": hypothesis(-np.inf),
    "hypothesis absent, -2e30": hypothesis(-2e30),
    "no hypothesis": Case(put("hypothesis_log_weight", slice(None), -np.inf), UNUSED, (), hypotheses=0),
    "members missing": no_hypothesis(drop("hypothesis_member"), "hypothesis_member: is missing", 2),
    "members of another shape": no_hypothesis(swap("hypothesis_member", TURNED), "hypothesis_member: has shape", 2),
    "hypothesis weights missing": no_hypothesis(drop("hypothesis_log_weight"), "hypothesis_log_weight: is missing", 3),
    "track mask missing": no_track(drop("track_valid"), "track_valid: is missing", 5),
    "track boxes missing": no_track(drop("track_box"), "track_box: is missing"),
    "track boxes of another shape": no_track(swap("track_box", np.ones((5, 8))), "track_box: has shape (5, 8)"),
    "track boxes ragged": no_track(swap("track_box", [[1.0], [1.0, 2.0]]), "track_box: is not an array (ValueError"),
    "track ids of floats": no_track(cast("track_id", float), "track_id: has dtype float64"),
    "double precision is taken": Case(cast("track_box", np.float64)),
    "double beyond single precision": track(
        both(cast("track_box", np.float64), put("track_box", (1, 0), 1e300)), "track_box: not finite"
    ),
    "boolean masks are taken": Case(cast("track_valid", bool)),
    "lists are taken": Case(lambda action: action.__setitem__("track_box", action["track_box"].tolist())),
    "NaN in an object": thing(put("object_box", (0, 0), np.nan), "object_box: not finite"),
    "class of an object unknown": thing(put("object_class", 0, 2), "object_class: unknown"),
    "NaN in a forecast": thing(put("forecast", (0, 1, 2, 0), np.nan), "forecast: not finite"),
    "NaN in an absent sample": Case(put("forecast", (0, 3), np.nan)),
    "forecast too far": thing(put("forecast", (0, 1, 2), [327.1, 0.0]), FAR),
    "forecast too far across": thing(put("forecast", (0, 1, 2), [300.0, 300.0]), FAR),
    "forecast just not too far": Case(put("forecast", (0, 1, 2), [0.0, -327.0])),
    "sample weight NaN": thing(put("forecast_log_weight", (0, 0), np.nan), "forecast_log_weight: NaN or +inf"),
    "one sample absent": Case(put("forecast_log_weight", (0, 0), -np.inf)),
    "all samples absent": thing(put("forecast_log_weight", 0, -2e30), "forecast_log_weight: no sample present"),
    "confidence NaN": thing(put("object_confidence", 0, np.nan), "object_confidence: not a probability"),
    "confidence above 1": thing(put("object_confidence", 0, 1.001), "object_confidence: not a probability"),
    "confidence 0 and 1": Case(put("object_confidence", slice(0, 2), [0, 1])),
    "no confidence": Case(drop("object_confidence")),
    "confidences of another shape": no_object(swap("object_confidence", np.ones(5)), "object_confidence: has shape"),
    "no parents": Case(drop("hypothesis_parent")),
    "parents of floats": no_hypothesis(cast("hypothesis_parent", float), "hypothesis_parent: has dtype float64", 2),
    "an unknown parent": Case(
        put("hypothesis_parent", 0, 3), "hypothesis_parent: unknown", (10, 11, 12), 2, 1, (0, 1, 0)
    ),
    "object mask missing": no_object(drop("object_valid"), "object_valid: is missing", 4),
    "forecasts missing": no_object(drop("forecast"), "forecast: is missing"),
    "forecasts with another k": no_object(swap("forecast", np.zeros((4, 5, 3, 2))), "forecast: has shape (4, 5, 3, 2)"),
    "sample weights missing": no_object(drop("forecast_log_weight"), "forecast_log_weight: is missing"),
    "object classes of floats": no_object(cast("object_class", float), "object_class: has dtype float64"),
    "unknown key": Case(swap("comment", np.zeros(3)), "action: has unknown keys"),
    "nothing said": Case(lambda action: action.update(empty_action(TASK)), "", (), 0, 0),
    "empty action": Case(lambda action: action.clear(), "track_id: is missing", (), 0, 0, (5, 3, 4)),
}


@pytest.mark.parametrize("case", CASES, ids=str)
def test_broken_rows_are_taken_out_counted_and_named(case: str) -> None:
    change, said, ids, objects, hypotheses, counted = CASES[case]
    action = full_action(TASK)
    change(action)
    answer = decode(action, TASK)
    assert tuple(answer.track_id) == ids
    assert len(answer.object_box) == len(answer.forecast) == len(answer.forecast_log_weight) == objects
    assert (np.isfinite(answer.hypothesis_log_weight).sum(), tuple(answer.invalid)) == (hypotheses, counted)
    assert answer.malformed.sum() == counted[2]
    for weight in (answer.hypothesis_log_weight, *answer.forecast_log_weight):
        assert np.exp(weight).sum() == pytest.approx(1.0 if np.isfinite(weight).any() else 0.0)
    assert np.isfinite(answer.track_box).all()
    problems = check_action(action, TASK).problems
    assert bool(problems) == bool(said)
    assert not problems or f"{problems[0].field}: {problems[0].reason}".startswith(said)
    assert any(problem.level == "error" for problem in problems) == any(counted)
    for rows, count in zip(ROW_KINDS, counted, strict=True):  # a row may have several reasons
        of_rows = [problem.rows for problem in problems if problem.kind == rows and problem.example]
        assert not of_rows or max(of_rows) <= count <= sum(of_rows)


def test_anything_but_a_dict_is_an_action_without_a_sound_row() -> None:
    actions: list[object] = [None, 3, "forecast", [1, 2], np.zeros(3)]
    for action in actions:
        recorded = decode(action, TASK)
        assert len(recorded.track_id) == len(recorded.object_box) == 0
        assert recorded.invalid.tolist() == [5, 3, 4]


def test_sound_rows_are_kept_as_stated() -> None:
    action = full_action(TASK)
    recorded = decode(action, TASK)
    np.testing.assert_array_equal(recorded.track_box, action["track_box"][:4])
    np.testing.assert_array_equal(recorded.member, action["hypothesis_member"][:, :4].T.astype(bool))
    np.testing.assert_allclose(recorded.hypothesis_log_weight[:2], [-np.log1p(np.exp(-1)), -1 - np.log1p(np.exp(-1))])
    assert (recorded.object_confidence.tolist(), recorded.hypothesis_parent.tolist()) == ([0.75, 0.75], [1, 0, -1])
    for name in ("object_confidence", "hypothesis_parent"):
        del action[name]
    recorded = decode(action, TASK)
    assert (recorded.object_confidence.tolist(), recorded.hypothesis_parent.tolist()) == ([1.0, 1.0], [-1, -1, -1])


MALFORMED: dict[str, tuple[Break, list[int]]] = {
    # what is broken, false forecasts that it counts as: cars, walkers, without a class (5 cars and 1 walker are seen)
    "nothing": (lambda action: None, [0, 0, 0]),
    "a walker": (both(put("object_class", 1, 1), put("object_box", (1, 0), np.nan)), [0, 1, 0]),
    "an unknown class": (put("object_class", 1, 7), [0, 0, 1]),
    "what is not there": (put("object_box", (3, 0), np.nan), [0, 0, 0]),
    "no forecasts": (drop("forecast"), [5, 1, 0]),
    "no mask": (drop("object_valid"), [5, 1, 0]),
    "tracks only": (drop("track_box"), [0, 0, 0]),
    "nothing said at all": (lambda action: action.clear(), [5, 1, 0]),
}


@pytest.mark.parametrize(("change", "want"), MALFORMED.values(), ids=MALFORMED.keys())
def test_what_a_broken_answer_counts_as(change: Break, want: list[int]) -> None:
    action = full_action(TASK)
    change(action)
    assert decode(action, TASK, detected=np.array([5, 1])).malformed.tolist() == want
    assert decode(None, TASK, detected=np.array([5, 1])).malformed.tolist() == [5, 1, 0]


def test_absent_samples_hold_zeros_whatever_was_there() -> None:
    action = full_action(TASK)
    action["forecast"][:, 2:] = 77.0
    np.testing.assert_array_equal(decode(action, TASK).forecast[:, 2:], 0)


def test_the_agent_s_arrays_are_left_alone_and_it_may_go_on_writing_into_them() -> None:
    action = full_action(TASK)
    for array in action.values():
        array.flags.writeable = False
    answer = decode(action, TASK)
    before = {name: np.array(value) for name, value in vars(answer).items()}
    for array in action.values():
        array.flags.writeable = True
        array[...] = 1
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(answer, name), value)


WILD = st.dictionaries(
    st.sampled_from(sorted(full_action(TASK))),
    st.one_of(
        st.none(),
        st.integers(),
        st.text(max_size=3),
        st_np.arrays(
            st.sampled_from([np.float64, np.float32, np.int64, np.int8, np.uint64, np.bool_, np.complex64]),
            st.sampled_from([(), (5,), (4,), (3,), (5, 7), (4, 7), (3, 5), (4, 4), (4, 4, 3, 2)]),
        ),
    ),
)


@given(WILD)
def test_whatever_comes_the_answer_is_sound(wild: dict[str, Any]) -> None:
    checked = check_action({**full_action(TASK), **wild}, TASK)
    answer = record_action(checked, TASK)
    assert np.isfinite(answer.track_box).all()
    assert np.isfinite(answer.object_box).all()
    assert np.isfinite(answer.forecast).all()
    assert (np.hypot(answer.forecast[..., 0], answer.forecast[..., 1]) < 32_750).all()  # cm
    assert (answer.track_box[:, 4:] > 0).all()
    assert answer.member.any(axis=1).all()
    for h in range(TASK.hypotheses):
        ids = answer.track_id[answer.member[:, h]]
        assert len(set(ids.tolist())) == len(ids)
    assert ((answer.invalid >= 0) & (answer.invalid <= [5, 3, 4])).all()
    for rows, count in zip(ROW_KINDS, answer.invalid, strict=True):
        assert not count or any(problem.kind == rows for problem in checked.problems), "nothing without a reason"
