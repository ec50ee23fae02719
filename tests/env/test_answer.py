"""Every way to break the contract takes out the row and counts it; nothing raises and nothing is gained."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np

from mtp_bench.env.decoding import FAINTEST, decode, log_softmax
from tests.support.small_scenes import Action, empty_action, full_action, task

TASK = task()
SOUND = {"tracks": [10, 11, 12, 12], "objects": 2, "hypotheses": 2}
Break = Callable[[Action], Any]


def put(key: str, index: Any, value: Any) -> Break:
    def change(action: Action) -> None:
        action[key][index] = value

    return change


def swap(key: str, value: Any) -> Break:
    return lambda action: action.__setitem__(key, value)


def cast(key: str, dtype: Any) -> Break:
    return lambda action: action.__setitem__(key, action[key].astype(dtype))


def drop(key: str) -> Break:
    return lambda action: action.pop(key)


# case: (change, ids left, objects left, hypotheses left, [tracks, hypotheses, objects] counted)
CASES: dict[str, tuple[Break, list[int], int, int, list[int]]] = {
    "nothing broken": (lambda action: None, [10, 11, 12, 12], 2, 2, [0, 0, 0]),
    "NaN in a track": (put("track_box", (1, 3), np.nan), [10, 12, 12], 2, 2, [1, 0, 0]),
    "infinite track": (put("track_box", (1, 0), np.inf), [10, 12, 12], 2, 2, [1, 0, 0]),
    "track far away": (put("track_box", (1, 1), 1.1e5), [10, 12, 12], 2, 2, [1, 0, 0]),
    "track without width": (put("track_box", (1, 5), 0.0), [10, 12, 12], 2, 2, [1, 0, 0]),
    "negative track size": (put("track_box", (1, 4), -1.0), [10, 12, 12], 2, 2, [1, 0, 0]),
    "track too large": (put("track_box", (1, 6), 101.0), [10, 12, 12], 2, 2, [1, 0, 0]),
    "negative id": (put("track_id", 1, -1), [10, 12, 12], 2, 2, [1, 0, 0]),
    "id beyond 31 bits": (put("track_id", 1, 2**31), [10, 12, 12], 2, 2, [1, 0, 0]),
    "class of a track unknown": (put("track_class", 1, 2), [10, 12, 12], 2, 2, [1, 0, 0]),
    "class of a track below -1": (put("track_class", 1, -2), [10, 12, 12], 2, 2, [1, 0, 0]),
    "no class for tracks": (drop("track_class"), [10, 11, 12, 12], 2, 2, [0, 0, 0]),
    "id twice in one hypothesis": (put("hypothesis_member", (0, 3), 1), [10, 11], 2, 2, [2, 0, 0]),
    "one id for all": (put("track_id", slice(0, 3), 12), [], 2, 2, [4, 0, 0]),
    "broken namesake does not count": (
        lambda action: [put("hypothesis_member", (0, 3), 1)(action), put("track_box", (3, 0), np.nan)(action)],
        [10, 11, 12],
        2,
        2,
        [1, 0, 0],
    ),
    "namesake in an absent hypothesis": (
        put("hypothesis_member", (2, slice(None)), 1),
        [10, 11, 12, 12],
        2,
        2,
        [0, 0, 0],
    ),
    "track in no hypothesis": (put("hypothesis_member", (slice(None), 1), 0), [10, 12, 12], 2, 2, [0, 0, 0]),
    "hypothesis weight NaN": (put("hypothesis_log_weight", 0, np.nan), [10, 11, 12], 2, 1, [0, 1, 0]),
    "hypothesis weight +inf": (put("hypothesis_log_weight", 0, np.inf), [10, 11, 12], 2, 1, [0, 1, 0]),
    "hypothesis absent, -inf": (put("hypothesis_log_weight", 0, -np.inf), [10, 11, 12], 2, 1, [0, 0, 0]),
    "hypothesis absent, -2e30": (put("hypothesis_log_weight", 0, -2e30), [10, 11, 12], 2, 1, [0, 0, 0]),
    "no hypothesis": (put("hypothesis_log_weight", slice(None), -np.inf), [], 2, 0, [0, 0, 0]),
    "members missing": (drop("hypothesis_member"), [], 2, 0, [0, 2, 0]),
    "members of another shape": (swap("hypothesis_member", np.ones((5, 3), dtype=bool)), [], 2, 0, [0, 2, 0]),
    "hypothesis weights missing": (drop("hypothesis_log_weight"), [], 2, 0, [0, 3, 0]),
    "track mask missing": (drop("track_valid"), [], 2, 2, [5, 0, 0]),
    "track mask of floats": (cast("track_valid", float), [], 2, 2, [5, 0, 0]),
    "track boxes missing": (drop("track_box"), [], 2, 2, [4, 0, 0]),
    "track boxes of another shape": (swap("track_box", np.ones((5, 8))), [], 2, 2, [4, 0, 0]),
    "track boxes of text": (swap("track_box", np.full((5, 7), "1")), [], 2, 2, [4, 0, 0]),
    "track boxes ragged": (swap("track_box", [[1.0], [1.0, 2.0]]), [], 2, 2, [4, 0, 0]),
    "track boxes complex": (cast("track_box", complex), [], 2, 2, [4, 0, 0]),
    "track boxes None": (swap("track_box", None), [], 2, 2, [4, 0, 0]),
    "track ids of floats": (cast("track_id", float), [], 2, 2, [4, 0, 0]),
    "track classes of floats": (cast("track_class", float), [], 2, 2, [4, 0, 0]),
    "double precision is taken": (cast("track_box", np.float64), [10, 11, 12, 12], 2, 2, [0, 0, 0]),
    "double beyond single precision": (
        lambda action: [cast("track_box", np.float64)(action), put("track_box", (1, 0), 1e300)(action)],
        [10, 12, 12],
        2,
        2,
        [1, 0, 0],
    ),
    "boolean masks are taken": (cast("track_valid", bool), [10, 11, 12, 12], 2, 2, [0, 0, 0]),
    "lists are taken": (
        lambda action: action.__setitem__("track_box", action["track_box"].tolist()),
        [10, 11, 12, 12],
        2,
        2,
        [0, 0, 0],
    ),
    "NaN in an object": (put("object_box", (0, 0), np.nan), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "object without height": (put("object_box", (0, 6), 0.0), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "class of an object unknown": (put("object_class", 0, 2), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "class of an object not stated": (put("object_class", 0, -1), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "NaN in a forecast": (put("forecast", (0, 1, 2, 0), np.nan), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "NaN in an absent sample": (put("forecast", (0, 3), np.nan), [10, 11, 12, 12], 2, 2, [0, 0, 0]),
    "forecast too far": (put("forecast", (0, 1, 2), [327.1, 0.0]), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "forecast too far across": (put("forecast", (0, 1, 2), [300.0, 300.0]), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "forecast just not too far": (put("forecast", (0, 1, 2), [0.0, -327.0]), [10, 11, 12, 12], 2, 2, [0, 0, 0]),
    "forecast of 1e38 m": (put("forecast", (0, 1, 2), 3e38), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "sample weight NaN": (put("forecast_log_weight", (0, 0), np.nan), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "sample weight +inf": (put("forecast_log_weight", (0, 0), np.inf), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "one sample absent": (put("forecast_log_weight", (0, 0), -np.inf), [10, 11, 12, 12], 2, 2, [0, 0, 0]),
    "all samples absent": (put("forecast_log_weight", 0, -2e30), [10, 11, 12, 12], 1, 2, [0, 0, 1]),
    "object mask missing": (drop("object_valid"), [10, 11, 12, 12], 0, 2, [0, 0, 4]),
    "forecasts missing": (drop("forecast"), [10, 11, 12, 12], 0, 2, [0, 0, 2]),
    "forecasts with another k": (swap("forecast", np.zeros((4, 5, 3, 2))), [10, 11, 12, 12], 0, 2, [0, 0, 2]),
    "sample weights missing": (drop("forecast_log_weight"), [10, 11, 12, 12], 0, 2, [0, 0, 2]),
    "object classes of floats": (cast("object_class", float), [10, 11, 12, 12], 0, 2, [0, 0, 2]),
    "unknown key": (swap("comment", np.zeros(3)), [10, 11, 12, 12], 2, 2, [0, 0, 0]),
    "empty action": (lambda action: action.clear(), [], 0, 0, [5, 3, 4]),
}


@pytest.mark.parametrize("case", CASES, ids=str)
def test_broken_rows_are_taken_out_and_counted(case: str) -> None:
    change, ids, objects, hypotheses, counted = CASES[case]
    action = full_action(TASK)
    change(action)
    answer = decode(action, TASK)
    assert answer.track_id.tolist() == ids
    assert len(answer.object_box) == len(answer.forecast) == len(answer.forecast_log_weight) == objects
    assert np.isfinite(answer.hypothesis_log_weight).sum() == hypotheses
    assert answer.invalid.tolist() == counted
    for weight in (answer.hypothesis_log_weight, *answer.forecast_log_weight):
        assert np.exp(weight).sum() == pytest.approx(1.0 if np.isfinite(weight).any() else 0.0)
    assert np.isfinite(answer.track_box).all()
    assert np.isfinite(answer.forecast).all()


@pytest.mark.parametrize("action", [None, 3, "forecast", [1, 2], np.zeros(3)], ids=str)
def test_anything_but_a_dict_is_an_answer_without_a_sound_row(action: object) -> None:
    answer = decode(action, TASK)
    assert len(answer.track_id) == len(answer.object_box) == 0
    assert answer.invalid.tolist() == [5, 3, 4]


def test_saying_nothing_is_no_violation() -> None:
    assert decode(empty_action(TASK), TASK).invalid.tolist() == [0, 0, 0]


def test_a_hypothesis_may_be_empty() -> None:
    action = full_action(TASK)
    action["hypothesis_member"][0] = 0
    answer = decode(action, TASK)
    assert np.isfinite(answer.hypothesis_log_weight).tolist() == [True, True, False]
    assert answer.member.any(axis=0).tolist() == [False, True, False]


def test_tracks_keep_what_was_said_of_them() -> None:
    action = full_action(TASK)
    answer = decode(action, TASK)
    np.testing.assert_array_equal(answer.track_box, action["track_box"][:4])
    np.testing.assert_array_equal(answer.member, action["hypothesis_member"][:, :4].T.astype(bool))
    np.testing.assert_allclose(answer.hypothesis_log_weight[:2], [-np.log1p(np.exp(-1)), -1 - np.log1p(np.exp(-1))])


def test_absent_samples_hold_zeros_whatever_was_there() -> None:
    action = full_action(TASK)
    action["forecast"][:, 2:] = 77.0
    np.testing.assert_array_equal(decode(action, TASK).forecast[:, 2:], 0)


def test_the_agent_may_go_on_writing_into_its_arrays() -> None:
    action = full_action(TASK)
    answer = decode(action, TASK)
    before = {name: np.array(value) for name, value in vars(answer).items()}
    for array in action.values():
        array[...] = 1
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(answer, name), value)


def test_the_agent_s_arrays_are_left_alone() -> None:
    action = full_action(TASK)
    for array in action.values():
        array.flags.writeable = False
    decode(action, TASK)


def test_a_faint_weight_is_present_and_minus_infinity_is_not() -> None:
    got = log_softmax(np.array([0.0, -1e29, -np.inf]), np.array([True, True, False]))
    assert got.tolist() == [0.0, FAINTEST, -np.inf]


def test_log_softmax_of_nothing_present() -> None:
    assert log_softmax(np.zeros((2, 3)), np.zeros((2, 3), dtype=bool)).tolist() == [[-np.inf] * 3] * 2


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
    answer = decode({**full_action(TASK), **wild}, TASK)
    assert np.isfinite(answer.track_box).all()
    assert np.isfinite(answer.object_box).all()
    assert np.isfinite(answer.forecast).all()
    assert (np.hypot(answer.forecast[..., 0], answer.forecast[..., 1]) < 327.5).all()
    assert (answer.track_box[:, 4:] > 0).all()
    assert answer.member.any(axis=1).all()
    for h in range(TASK.hypotheses):
        ids = answer.track_id[answer.member[:, h]]
        assert len(set(ids.tolist())) == len(ids)
    assert ((answer.invalid >= 0) & (answer.invalid <= [5, 3, 4])).all()
