"""Event weights of an env: frozen where the card ships, made where it does not, and never taken on trust."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench import MTPEnv
from mtp_bench.agent import load_submission
from mtp_bench.cards import load_card, with_presence
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.judge.records.running import plan_run
from mtp_bench.running.comparison import compare
from mtp_bench.running.options import RunOptions
from mtp_bench.running.perturbation import RUNS
from mtp_bench.running.playing import jobs_of, run_jobs, run_scene
from mtp_bench.running.reference import (
    card_budget,
    freeze,
    frozen_reference,
    make_reference,
    ranked_scenes,
    reference_for,
    track,
)
from mtp_bench.scoring import score_scene
from mtp_bench.scoring.bade import ONE_PER_TARGET, CardBudget
from mtp_bench.scoring.weights import WEIGHTED_SUBSETS, read_reference, scene_key, tracking_events, write_reference
from tests.support.command_line import CommandLine
from tests.support.small_scenes import CARD, write_card

FROZEN = sorted((Path(__file__).parents[2] / "envs" / "reference").glob("MTP-*.json"))


def scenes_of(env: str, data: str) -> tuple[str, ...]:
    return MTPEnv(env, data=data).scene_names


def test_what_is_frozen_is_found_again(cli: CommandLine, shipped: str, kitti: str) -> None:
    card, scenes = load_card(shipped), scenes_of(shipped, kitti)
    assert frozen_reference(card) is None
    made = reference_for(card, scenes, RunOptions(kitti))
    assert not made.frozen
    mask = os.umask(0o077)
    try:
        said = cli.ok("maintain", "freeze", "--env", shipped, "--data", kitti, "--jobs", 1)
    finally:
        os.umask(mask)
    path = Path(said.partition(": ")[0])
    assert said.startswith(f"{path}: {made.totals['targets']} targets, sum of weights ids ")
    assert made.digest in said
    assert (path.stat().st_mode & 0o777, [p.name for p in path.parent.iterdir()]) == (0o644, [path.name])
    read = reference_for(card, scenes[:1], RunOptions("nowhere"))  # nothing is run
    assert (read.frozen, read.digest) == (True, made.digest)
    assert (read.env, read.agent, read.card, read.runs) == (shipped, "stp", card.digest, RUNS)


def test_the_plain_run_and_the_counts_are_those_of_the_scenes(card: str, kitti: str) -> None:
    """Small scenes are made for this: what `compare` says of STP is in its reference."""
    loaded, scenes = load_card(card), scenes_of(card, kitti)
    with pytest.raises(MtpBenchError, match="got 256 seeds of event weights, expected at most 255"):
        make_reference(loaded, scenes, RunOptions(kitti), range(256))
    made = make_reference(loaded, scenes, RunOptions(kitti))
    scores = run_jobs(jobs_of(load_submission("stp"), card, {"data": kitti}, scenes), finish=score_scene)
    for score in scores:
        known = made.of(score.scene)
        assert known.targets == len(score) == len(known.stp)
        np.testing.assert_array_equal(known.stp[:, 0], score.own_ids)
        np.testing.assert_array_equal(made.weight(score.scene, "paper_frag") > 0, score.own_frag)
        assert known.stp_events == tuple(score.own_events[kind] for kind in ("ids", "lost", "reacquired"))
        assert (known.counts <= RUNS).all()
        assert (known.counts[:, 3] >= known.counts[:, 1:3].max(axis=1)).all()
        for subset in WEIGHTED_SUBSETS:
            assert made.weight(score.scene, subset).shape == (len(score),)
    assert made.totals["sum_of_weights"]["lost"] > 0
    assert made.budget == CardBudget(made.env, sum(score.false_forecasts for score in scores), sum(map(len, scores)))


@pytest.mark.parametrize("assignment", ["hungarian", "greedy"])
def test_tracks_are_recorded_as_the_env_records_them(assignment: str) -> None:
    card, chosen = load_card("MTP-Intersection-v0"), {"assignment": assignment, "forecasts": False}
    env = MTPEnv(card, evaluation=True)
    agent, name = load_submission("stp").build(env.task, **chosen), env.scene_names[0]
    whole = run_scene(agent, env, name, seed=0)
    light = track(agent, env.scene, env.task, env.card)
    for part in ("track_start", "track_id", "track_box", "track_class"):
        got, wanted = getattr(light, part), getattr(whole, part)
        assert got.dtype == wanted.dtype
        np.testing.assert_array_equal(got, wanted)
    assert len(whole.track_id) > 100
    assert len(whole.object_box) == 0
    events, others = (tracking_events(env.scene, rollout, card) for rollout in (whole, light))
    np.testing.assert_array_equal(events, others)
    assert events.any()


@pytest.mark.usefixtures("few_event_runs")
def test_a_changed_card_or_a_scene_that_is_not_there_makes_its_own(shipped: str, tmp_path: Path, kitti: str) -> None:
    """Budgets are constants of the card, whatever part of the split is run and whatever is changed in it."""
    path, frozen = freeze(shipped, RunOptions(kitti))
    other = load_card(write_card(tmp_path, CARD.replace("miss_error = 2.0", "miss_error = 3.0")))
    assert frozen_reference(other) is None
    scenes, card = scenes_of(shipped, kitti), load_card(shipped)
    made = reference_for(other, scenes[:1], RunOptions(kitti))
    assert (made.frozen, made.card) == (False, other.digest)
    assert len(json.loads(path.read_text())["scenes"]) == len(scenes)
    part = make_reference(card, scenes[:1], RunOptions(kitti))
    assert part.of(scenes[0]).targets == frozen.of(scenes[0]).targets
    assert not part.holds(scenes)
    assert part.budget != frozen.budget  # as of hidden scenes
    for reference in (made, *(reference_for(card, some, RunOptions(kitti)) for some in (scenes, scenes[:1]))):
        assert reference.budget == frozen.budget


def test_another_presence_model_keeps_the_frozen_weights() -> None:
    card = load_card("MTP-nuScenes-mini-v0")
    frozen, other = frozen_reference(card), frozen_reference(with_presence(card, "scores"))
    assert frozen is not None
    assert other is not None, "confidences change no event"
    assert other.digest == frozen.digest


@pytest.mark.parametrize("env_id", [path.stem for path in FROZEN])
def test_budgets_of_a_full_split_are_those_of_definitions_3_0(env_id: str) -> None:
    """There they were equal steps up to the false forecasts of STP, to the last digit."""
    known = card_budget(env_id)
    budgets = known.budgets(known.divisor, known.false_known)
    if known.false_known:
        assert np.array_equal(budgets.all, np.arange(1, 11) * min(float(known.divisor), float(known.forecasts)) / 10)
        assert budgets.subsets == known.forecasts
    else:
        assert budgets.all.tolist() == [20.0, 40.0, budgets.subsets] == [20.0, 40.0, known.forecasts / known.divisor]


def test_constants_of_the_cards_that_ship() -> None:
    targets_alone = card_budget("MTP-nuScenes-v0")
    assert targets_alone == CardBudget("MTP-nuScenes-v0", 166_536, 3_331, false_known=False)
    assert targets_alone.budgets(100, false_known=False).all.tolist() == pytest.approx([20, 40, 49.9957970579])
    assert targets_alone.budgets(100).subsets == 100.0  # own scenes with complete truth: one per target
    assert targets_alone.text() == "up to 1 per target (no constant for such scenes)"
    mini = card_budget("MTP-nuScenes-mini-v0")
    assert (mini.false_known, mini.budgets(100, false_known=False).all.tolist()) == (True, [20.0, 40.0])
    assert mini.budgets(mini.divisor).subsets == mini.forecasts  # exactly, on the scored split
    assert mini.budgets(mini.divisor).all[-1] == mini.divisor
    for env_id in ("MTP-Drive-Merge-v0", "MTP-nuScenes-Lanes-v0", "MTP-Mine-v0"):  # ways, no file, another's card
        assert card_budget(env_id) == ONE_PER_TARGET


@pytest.mark.usefixtures("few_event_runs")
def test_scenes_without_frozen_weights_are_left_out(shipped: str, tmp_path: Path, kitti: str) -> None:
    """More data than there was when weights were frozen, such as the whole split of nuScenes: ranks are of the same."""
    path, whole = freeze(shipped, RunOptions(kitti))
    card, scenes = load_card(shipped), scenes_of(shipped, kitti)
    assert ranked_scenes(card, scenes) == scenes
    known = tuple(name for name in scenes if name != scenes[0])
    keys = [scene_key(shipped, name) for name in known]
    write_reference(path, replace(whole, scenes={key: whole.scenes[key] for key in keys}))
    assert ranked_scenes(card, scenes) == known
    assert ranked_scenes(card, scenes[:1]) == scenes[:1], "of these alone nothing is known"
    compared = compare(["stp"], shipped, RunOptions(kitti), full=False)
    assert (compared.reference.frozen, compared.reference.digest) == (True, read_reference(path).digest)
    assert compared.report.condition["weights"].endswith(
        f"; 1 of {len(scenes)} scenes of the split have none and are left out"
    )
    plan = plan_run(load_submission("stp"), shipped, RunOptions(kitti))
    assert (plan.scenes, plan.scenes_of_split) == (known, len(known))


@pytest.mark.parametrize("path", FROZEN, ids=[path.stem for path in FROZEN])
def test_the_shipped_files_fit_their_cards(path: Path) -> None:
    env_id = path.stem
    reference = frozen_reference(load_card(env_id))
    assert reference is not None
    drives, sums = load_card(env_id).drive is not None, reference.totals["sum_of_weights"]
    assert (reference.runs, reference.agent) == ((1, "gt_tracks") if drives else (RUNS, "stp"))
    assert read_reference(path).digest == reference.digest
    assert sums["ids"] > 0 or drives
    assert 0 < sums["lost"] <= sums["frag"] or drives
    assert sums["frag"] <= sums["lost"] + sums["reacquired"] + 0.02  # they are rounded


def test_the_plain_run_is_still_that_of_the_frozen_file() -> None:
    """Traffic, detector and tracker together: a change of any of them needs a new version or new frozen files."""
    card = load_card("MTP-Intersection-v0")
    frozen, scene = frozen_reference(card), MTPEnv(card).scene_names[0]
    assert frozen is not None
    made = make_reference(card, [scene], seeds=range(1))
    for name in ("targets", "stp_events", "false_forecasts", "forecasts"):
        assert getattr(made.of(scene), name) == getattr(frozen.of(scene), name)
    np.testing.assert_array_equal(made.of(scene).stp, frozen.of(scene).stp)
