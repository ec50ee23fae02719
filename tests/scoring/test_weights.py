"""Event weights: what is counted, what a file holds, and files that are wrong."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.core.errors import DataError
from mtp_bench.scoring.definitions import WEIGHTS_DEFINITIONS
from mtp_bench.scoring.weights import (
    WEIGHTED_SUBSETS,
    Reference,
    SceneWeights,
    count_runs,
    read_reference,
    scene_key,
    tracking_events,
    write_reference,
)
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene

CARD = make_card(future=1)
STREAMS = {  # one object for five frames: the track that it has in each; switches, losses, re-acquisitions by frame
    "111111": ([], [], []),
    "122222": ([1], [], []),
    "12-211": ([1, 4], [2], [3]),
    "1--2-2": ([], [1, 4], [3, 5]),
}


def events_of(stream: str) -> Any:
    tracks = [[] if c == "-" else [Thing(int(c), 0, 0)] for c in stream]
    return tracking_events(make_scene([[Thing(5, 0, 0)]] * len(stream)), make_rollout(tracks, future=1), CARD)


def reference_of_streams(**changes: Any) -> Reference:
    """Two scenes; every stream is a run of the first, whose targets are frames 1 to 4."""
    counts = count_runs([events_of(stream)[1:5] for stream in STREAMS], 4)
    first = SceneWeights(counts, events_of("12-211")[1:5], (2, 1, 1), 3, 7)
    nothing = np.zeros((2, 4), dtype=np.uint8)
    second = SceneWeights(nothing, nothing[:, :3].astype(bool), (1, 0, 0), 4, 5)
    scenes = {scene_key(CARD.id, "s"): first, scene_key(CARD.id, "z"): second}
    whole = Reference(CARD.id, CARD.digest, WEIGHTS_DEFINITIONS, "stp", len(STREAMS), {"dropped": 0.05}, scenes)
    return replace(whole, **changes)


@pytest.fixture
def reference() -> Reference:
    return reference_of_streams()


WEIGHTS = {  # of the four targets, in quarters
    "ids": [2, 0, 0, 1],
    "lost": [1, 1, 0, 1],
    "reacquired": [0, 0, 2, 0],
    "frag": [1, 1, 2, 1],
    "paper_ids": [4, 0, 0, 4],
    "paper_frag": [0, 4, 4, 0],
}


@pytest.mark.parametrize("subset", WEIGHTED_SUBSETS)
def test_the_weight_is_the_share_of_the_runs(reference: Reference, subset: str) -> None:
    weight = reference.weight("s", subset)
    assert weight.dtype == np.float64
    assert (4 * weight).tolist() == WEIGHTS[subset]
    assert reference.weight("z", subset).tolist() == [0, 0]


def test_a_file_holds_the_same_and_no_scene(reference: Reference, tmp_path: Path) -> None:
    path = tmp_path / "reference.json"
    write_reference(path, reference)
    again = read_reference(path)
    assert again.digest == reference.digest
    for subset in WEIGHTED_SUBSETS:
        assert np.array_equal(again.weight("s", subset), reference.weight("s", subset))
    assert (again.of("s").stp_events, (again.of("s").false_forecasts, again.of("s").forecasts)) == ((2, 1, 1), (3, 7))
    text = path.read_text()
    content = json.loads(text)
    assert list(content["scenes"]) == sorted(hashlib.sha256(f"{CARD.id}/{n}".encode()).hexdigest()[:16] for n in "sz")
    assert sum(any(key in line for key in content["scenes"]) for line in text.splitlines()) == 2  # a line per scene
    assert content["totals"]["events_of_stp"] == {"ids": 3, "lost": 1, "reacquired": 1}
    assert content["totals"]["sum_of_weights"] == {"ids": 0.75, "lost": 0.75, "reacquired": 0.5, "frag": 1.25}
    assert [p.name for p in tmp_path.iterdir()] == [path.name]  # nothing half-written is left


def test_everything_in_it_is_in_the_digest(reference: Reference) -> None:
    scene = reference.of("s")
    changed = [
        replace(scene, counts=np.asarray(scene.counts + 1, dtype=np.uint8)), replace(scene, stp=~scene.stp),
        replace(scene, stp_events=(2, 1, 2)), replace(scene, false_forecasts=4), replace(scene, forecasts=8),
    ]  # fmt: skip
    key = scene_key(CARD.id, "s")
    others = [replace(reference, scenes={**reference.scenes, key: one}) for one in changed]
    others += [reference_of_streams(**{name: "x"}) for name in ("env", "card", "definitions", "agent")]
    others += [reference_of_streams(runs=5), reference_of_streams(parameters={}), reference_of_streams(scenes={})]
    assert len({one.digest for one in [reference, *others]}) == len(others) + 1
    assert replace(reference, frozen=True).digest == reference.digest


KEY = scene_key(CARD.id, "s")


def edited(key: str, value: Any) -> Any:
    return lambda content: json.dumps({**content, key: value})


def scene_edited(key: str, value: Any) -> Any:
    def change(content: dict[str, Any]) -> str:
        content["scenes"][KEY][key] = value
        return json.dumps(content)

    return change


BROKEN: dict[str, tuple[Any, str]] = {
    "cut off": (lambda content: json.dumps(content)[:99], "not valid JSON"),
    "no run": (edited("runs", 0), "runs: got 0: "),
    "another hash": (edited("hash", "0"), "hash is '0', the content has '"),
    "other totals": (edited("totals", {}), "totals is {}, the content has"),
    "a scene less": (edited("scenes", {}), "counts has another size than 0 x 4"),
    "a scene that is none": (edited("scenes", {KEY: 3}), f"scenes.{KEY}: got 3: expected a table"),
    "a negative count": (scene_edited("forecasts", -1), f"scenes.{KEY}.forecasts: got -1"),
    "a count that is none": (scene_edited("targets", True), f"scenes.{KEY}.targets: got True"),
    "fewer targets": (scene_edited("targets", 3), "counts has another size than "),
    "too many targets": (scene_edited("targets", 10**9), "targets of all scenes are 1000000"),
    "no base64": (edited("counts", "é"), "counts cannot be read"),
    "not packed": (edited("stp", "A" * 40), "stp cannot be read"),
    "packed, cut off": (lambda content: edited("stp", content["stp"][:40])(content), "stp "),
}


@pytest.mark.parametrize(("change", "message"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_file_is_named_with_its_key(reference: Reference, tmp_path: Path, change: Any, message: str) -> None:
    path = tmp_path / "reference.json"
    write_reference(path, reference)
    path.write_text(change(json.loads(path.read_text())))
    with pytest.raises(DataError) as error:
        read_reference(path)
    assert str(error.value).startswith(f"{path}: ")
    assert message in str(error.value)
