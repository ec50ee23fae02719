"""An action made from plain arrays: what is filled in, what is left out, and which errors there are."""

from pathlib import Path
from typing import Any

import numpy as np

from mtp_bench import Tracks, make_action
from mtp_bench.agent.action import ACTION_FIELDS
from mtp_bench.env.spaces import ActionSpace
from tests.support.small_scenes import decode, task

TASK = task()  # N 5, O 4, H 3, K 4, T 3
BOX = np.array([[1.0, 2, 0, 0.5, 4, 2, 1.5], [5, 6, 0, 0, 1, 1, 2]])
CLASS = np.array([0, 1])
FUTURE = np.arange(12.0).reshape(2, 3, 2)


def test_the_table_of_the_fields_is_in_the_documentation(repository: Path) -> None:
    lines = ["| field | shape | dtype | entries | meaning |", "|---|---|---|---|---|"]
    for field in ACTION_FIELDS:
        shape, dtype = field.shape.replace(" ", ", "), np.dtype(field.content.dtype)
        meaning = field.meaning + (" Optional." if field.optional else "")
        lines.append(f"| `{field.name}` | ({shape}) | {dtype} | {field.content.expected} | {meaning} |")
    assert "\n".join(lines) + "\n" in (repository / "envs/README.md").read_text()


def test_every_action_lies_in_the_space() -> None:
    action = make_action(TASK, BOX, CLASS, FUTURE, ids=[3, 4])
    space: Any = ActionSpace(TASK)
    assert action in space
    assert {name: array for name, array in action.items() if name != "forecast"} not in space
    assert list(action) == [field.name for field in ACTION_FIELDS]
    assert {name: (part.shape, part.dtype) for name, part in space.spaces.items()} == {
        name: (array.shape, array.dtype) for name, array in action.items()
    }


def test_objects_alone_say_nothing_of_tracks() -> None:
    got = decode(make_action(TASK, BOX, CLASS, FUTURE), TASK)
    np.testing.assert_array_equal(got.object_box, BOX)
    assert got.object_class.tolist() == [0, 1]
    np.testing.assert_array_equal(got.forecast[:, 0], 100 * FUTURE)
    assert (got.forecast_log_weight.tolist(), len(got.track_id)) == ([[0, -np.inf, -np.inf, -np.inf]] * 2, 0)
    assert np.isneginf(got.hypothesis_log_weight).all()
    assert not got.invalid.any()
    nothing: list[Any] = [np.zeros((0, 7)), []]
    for none in nothing:
        empty = decode(make_action(TASK, none, [], [], confidence=[], ids=[]), TASK)
        assert len(empty.track_id) == len(empty.object_box) == empty.invalid.sum() == 0


def test_ids_make_them_the_tracks_of_one_hypothesis() -> None:
    got = decode(make_action(TASK, BOX, CLASS, FUTURE, ids=[8, 9]), TASK)
    assert (got.track_id.tolist(), got.track_class.tolist()) == ([8, 9], [0, 1])
    np.testing.assert_array_equal(got.track_box, BOX)
    assert got.hypothesis_log_weight.tolist() == [0, -np.inf, -np.inf]
    assert got.member[:, 0].all()


def test_samples_and_their_weights() -> None:
    samples = np.stack([FUTURE, 2 * FUTURE], axis=1)
    got = decode(make_action(TASK, BOX, CLASS, samples, [[0.0, 0.0], [1.0, -np.inf]]), TASK)
    np.testing.assert_array_equal(got.forecast[0, :2], 100 * samples[0])
    np.testing.assert_allclose(np.exp(got.forecast_log_weight), [[0.5, 0.5, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])


def test_what_does_not_fit_is_left_out_the_least_likely_first() -> None:
    # Leaves 0 and 3 in the best hypothesis, 2 in the second, 1 in the third; room for two hypotheses, three tracks.
    tracks = Tracks(
        track_id=np.array([10, 11, 12, 13]), box=np.arange(1.0, 29.0).reshape(4, 7), class_id=np.array([0, 1, 1, 0]),
        score=np.ones(4), detection=np.arange(4), past=np.zeros((4, 10, 7)), past_valid=np.ones((4, 10), dtype=bool),
        member=np.array([[1, 0, 0, 1], [0, 0, 1, 1], [0, 1, 0, 0]], dtype=bool), log_weight=np.log([0.5, 0.3, 0.2]),
    )  # fmt: skip
    action = make_action(task(tracks=3, hypotheses=2, objects=1), BOX, CLASS, FUTURE, tracks=tracks)
    assert (action["track_id"].tolist(), action["track_class"].tolist()) == ([10, 12, 13], [0, 1, 0])
    assert action["hypothesis_member"].tolist() == [[1, 0, 1], [0, 1, 1]]
    np.testing.assert_allclose(np.exp(action["hypothesis_log_weight"]), [0.5, 0.3])
    np.testing.assert_array_equal(action["object_box"], BOX[:1])


def test_numbers_can_be_left_to_the_env() -> None:
    got = decode(make_action(TASK, BOX, CLASS, FUTURE + 400, checked=False), TASK)
    assert got.invalid.tolist() == [0, 0, 2]
