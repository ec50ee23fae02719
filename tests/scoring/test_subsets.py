"""Frozen subsets: what they hold, that they name nothing, and files that are wrong."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.errors import CardError, DataError
from mtp_bench.scoring import (
    DEFINITIONS,
    SUBSETS,
    ReferenceSubsets,
    masks,
    read_reference,
    reference_subsets,
    score_scene,
    write_reference,
)
from mtp_bench.scoring.subsets import event_keys
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene, random_case

CARD = make_card(future=1)
# One object for seven frames; targets are frames 1 to 5. Its tracks: a switch, a loss, a re-acquisition, a loss at the
# end, where nothing is to be forecast.
STREAM = "11 2-2 -".replace(" ", "")


def score_of(stream: str, name: str = "s") -> Any:
    tracks = [[] if c == "-" else [Thing(int(c), 0, 0)] for c in stream]
    scene = make_scene([[Thing(5, 0, 0)]] * len(stream), name)
    return score_scene(scene, make_rollout(tracks, future=1, name=name), CARD)


@pytest.fixture
def reference() -> ReferenceSubsets:
    return reference_subsets([score_of(STREAM), score_of("1122", "z")], CARD)


def test_keys_are_hashes_of_env_scene_object_and_frame() -> None:
    got = event_keys("E", "s", np.array([5, 12]), np.array([0, 3]))
    want = [hashlib.sha256(text).hexdigest()[:12] for text in (b"E|s|5|0", b"E|s|12|3")]
    assert [f"{key:012x}" for key in got.tolist()] == want


def test_subsets_hold_all_events_and_mask_the_targets(reference: ReferenceSubsets) -> None:
    assert STREAM == "112-2-"
    assert [len(reference.keys(kind)) for kind in SUBSETS[1:]] == [2, 2, 1, 3]
    score = score_of("111111")
    assert score.frame.tolist() == [1, 2, 3, 4]
    got = {name: score.frame[mask].tolist() for name, mask in masks(reference, score).items()}
    assert got == {"all": [1, 2, 3, 4], "ids": [2], "lost": [3], "reacquired": [4], "frag": [3, 4]}


def test_the_evaluated_agent_does_not_move_the_subsets(reference: ReferenceSubsets) -> None:
    for stream in ("------", "123456"):
        assert masks(reference, score_of(stream))["ids"].tolist() == [False, True, False, False]
    assert not masks(reference, score_of("111111", "another scene"))["ids"].any()


def test_a_file_holds_the_same_and_no_scene_or_object(reference: ReferenceSubsets, tmp_path: Path) -> None:
    path = tmp_path / "subsets.json"
    write_reference(path, reference)
    again = read_reference(path, CARD)
    assert again.hash == reference.hash
    for kind in SUBSETS[1:]:
        assert np.array_equal(again.keys(kind), reference.keys(kind))
    content = json.loads(path.read_text())
    assert content["counts"] == {"ids": 2, "lost": 2, "reacquired": 1}
    assert (content["env"], content["card"], content["definitions"]) == (CARD.id, CARD.digest, DEFINITIONS)
    assert all(len(key) == 12 and key == key.lower() for keys in content["events"].values() for key in keys)
    assert content["events"]["ids"] == sorted(content["events"]["ids"])
    assert [p.name for p in tmp_path.iterdir()] == ["subsets.json"]  # nothing half-written is left


def test_the_hash_does_not_depend_on_the_order_of_scenes() -> None:
    scores = [score_scene(*random_case(seed, name=f"s{seed}"), make_card()) for seed in range(3)]
    card = make_card()
    assert reference_subsets(scores, card).hash == reference_subsets(scores[::-1], card).hash
    assert reference_subsets(scores[:2], card).hash != reference_subsets(scores, card).hash


def test_no_scene_no_event() -> None:
    assert [len(reference_subsets([], CARD).keys(kind)) for kind in SUBSETS[1:]] == [0, 0, 0, 0]


def edit(key: str, value: Any) -> Any:
    def change(content: dict[str, Any]) -> str:
        return json.dumps({**content, key: value})

    return change


BROKEN: dict[str, tuple[Any, str]] = {
    "an event added": (edit("events", {"ids": ["0" * 12], "lost": [], "reacquired": []}), "the content has the hash"),
    "hash changed": (edit("hash", "0" * 64), "the file says 0000"),
    "hash missing": (lambda content: json.dumps({k: v for k, v in content.items() if k != "hash"}), "says None"),
    "kind missing": (edit("events", {"ids": []}), "not a file of reference subsets: KeyError 'lost'"),
    "not a number": (edit("events", {"ids": ["xyz"], "lost": [], "reacquired": []}), "not a file of reference subsets"),
    "cut off": (lambda content: json.dumps(content)[:50], "not valid JSON"),
    "a list": (lambda content: "[1, 2]", "not a file of reference subsets"),
}


@pytest.mark.parametrize(("change", "message"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_file_is_an_error(reference: ReferenceSubsets, tmp_path: Path, change: Any, message: str) -> None:
    path = tmp_path / "subsets.json"
    write_reference(path, reference)
    path.write_text(change(json.loads(path.read_text())))
    with pytest.raises(DataError, match=message):
        read_reference(path, CARD)


def test_a_missing_file_says_how_to_make_it(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no reference subsets at .*; score the baseline 'stp' to make them"):
        read_reference(tmp_path / "none.json", CARD)


def test_subsets_of_another_card_or_of_other_definitions(reference: ReferenceSubsets, tmp_path: Path) -> None:
    path = tmp_path / "subsets.json"
    write_reference(path, reference)
    with pytest.raises(CardError, match=f"subsets of MTP-Test-v0 with card digest {CARD.digest}, expected MTP-Test-v0"):
        read_reference(path, make_card(future=2))
    old = ReferenceSubsets(
        reference.env, reference.card, "stp", "0.1", reference.ids, reference.lost, reference.reacquired
    )
    write_reference(path, old)
    with pytest.raises(DataError, match=f"made with definitions 0.1, expected {DEFINITIONS}"):
        read_reference(path, CARD)
