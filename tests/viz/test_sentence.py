"""Facts that the sentences of recorded runs state, worked out a second time from the tables of the run."""

import re
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.agent.loader import load_submission
from mtp_bench.cards import load_card
from mtp_bench.sources import open_source
from mtp_bench.viz.evidence import reach
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.framing import frame_of
from mtp_bench.viz.moment_list import moments
from mtp_bench.viz.run_replay import replay
from mtp_bench.viz.sentences import WORDS, sentence
from tests.support.runs import run_scenes

RUNS = {  # scenes with sentences of all kinds: others say little more
    "MTP-KITTI-v0": slice(6, 9), "MTP-nuScenes-mini-v0": slice(1), "MTP-PETS-v0": slice(4),
    "MTP-Intersection-v0": slice(2),
}  # fmt: skip


@pytest.mark.data
@pytest.mark.parametrize("env_id", RUNS)
def test_sentences_state_facts(env_id: str, data_root: Path) -> None:
    card, submission = load_card(env_id), load_submission("stp")
    names = open_source(card, str(data_root)).names[RUNS[env_id]]
    make, keywords = submission.factory(submission.parameters), {"data": str(data_root)}
    runs = run_scenes(make, env_id, keywords, names, finish=replay)
    focuses = [Focus(run, at) for run in runs for at in (*run.incidents, *(m.at for m in moments(run)[:20]))]
    assert len(focuses) > 200
    for focus in focuses:
        check(focus, sentence(focus))


def check(focus: Focus, text: str) -> None:
    """Check that a sentence is short, names what is drawn, and agrees with the tables of the run."""
    at, t, run = focus.at, focus.at.frame, focus.replay
    where = f"{run.scene.name} {text}"
    first, *others = text.partition(": ")[2].split(". ")
    assert len(others) <= 2, where
    for part in (first, *others):
        assert len(re.sub(r"(which costs \S+ m): .*", r"\1", part).split()) <= WORDS, where
    for track in {int(number) for number in re.findall(r"track (\d+)", text)}:
        assert track in focus.named_tracks, where
        drawn = track in {each.track_id for each in frame_of(focus, t).tracks}
        assert drawn == (focus.track_rows(track)[t] >= 0), where
    for name in re.findall(r"\(((?:ids|lost|reacquired|spurious)-\d+)", text):
        other = run.incident(name)
        first_frame, last = (t, at.until) if at.kind == "spurious" else (other.frame, other.until)
        assert other.object_id == at.object_id or first_frame <= max(t, other.frame) <= last, where
    check_metres(focus, text, where)
    check_detections(focus, text, where)
    assert at.kind != "lost" or focus.follower(t) < 0, where
    assert (" no track " in text or "had no track" in text) <= (at.object_id >= 0 and focus.follower(t) < 0), where
    assert ("has no forecast" in text) == (at.parts is not None and focus.forecast(t) is None), where


def check_metres(focus: Focus, text: str, where: str) -> None:
    """Check distances of tracks, ends of forecasts and costs, and whose forecast counts."""
    at, t, run = focus.at, focus.at.frame, focus.replay
    for track, metres in re.findall(r"[Tt]rack (\d+) is ([\d.]+) m away", text):
        far = np.hypot(*(run.rollout.track_box[focus.track_rows(int(track))[t], :2] - focus.place(t)))
        assert shown(far, metres), where
        assert at.kind != "lost" or far >= reach(focus) or focus.other(int(track), t) >= 0, where
    for metres in re.findall(r"and ends ([\d.]+) m off", text):
        forecast, future = focus.forecast(t), focus.future(t)
        assert forecast is not None
        assert shown(np.hypot(*(forecast.nearest_path[len(future) - 1] - future[-1])), metres), where
    assert all(f"{at.error:.1f}" == metres for metres in re.findall(r"costs ([\d.]+) m", text)), where
    for track in re.findall(r"forecast of track (\d+).* counts for it", text):
        assert run.answers.object_track_id[run.truth_forecast[focus.rows[t]]] == int(track) != at.new_id, where


def shown(value: float, text: str) -> bool:
    """True if the text is the number, rounded to its digits."""
    return f"{value:.{len(text.partition('.')[2])}f}" == text


def check_detections(focus: Focus, text: str, where: str) -> None:
    """Check what is detected at the object, and that class confusion is said wherever an object is lost or a ghost."""
    at, t, scene = focus.at, focus.at.frame, focus.replay.scene
    table, place, truth = scene.detections, focus.place(t), scene.truth
    seen = focus.replay.detected[table.rows(t)]
    far, own = np.hypot(*(table.box[table.rows(t), :2] - place).T), table.class_id[table.rows(t)] == at.class_id
    if at.kind == "lost":
        assert ("detection there says" in text) == bool((far[~own] <= reach(focus)).any()), where
    if at.kind == "spurious":
        others = truth.box[truth.rows(t), :2][truth.class_id[truth.rows(t)] != at.class_id]
        near = bool((np.hypot(*(others - place).T) <= reach(focus)).any())
        assert (": The true " in text or ". The true " in text) == near, where
    for metres in re.findall(r"is detected within (\S+) m", text):
        assert not (far[own] <= float(metres)).any(), where
    for metres, of in re.findall(r"nearest \S.* detection(?: is|,) ([\d.]+) m away(, is that of)?", text):
        assert shown(far[own].min(), metres), where
        assert at.object_id not in seen, where
        assert (seen[own][np.argmin(far[own])] >= 0) == bool(of), where
    for metres in re.findall(r"it is detected ([\d.]+) m", text):
        assert shown(float(far[seen == at.object_id].item()), metres), where
    for metres in re.findall(r"takes a detection of no object, ([\d.]+) m", text):
        assert any(shown(each, metres) for each in far[seen < 0]), where
    said_of = re.findall(r"(?:is that|the detection) of (?=(.*))", text)
    for row in range(truth.start[t], truth.start[t + 1]) if said_of else ():
        if any(re.match(rf"{re.escape(focus.name_of(row))}\b", said) for said in said_of):
            assert truth.object_id[row] in seen, where
    if "ast detected at " in text or "here since " in text:
        last = table.frame_of_rows[focus.replay.detected == at.object_id]
        first, last = truth.frame_of_rows[truth.object_id == at.object_id][0], last[last <= t][-1:]
        since, when = ("ast detected at", last[0]) if len(last) else ("here since", first)
        assert f"{since} {focus.seconds(when):.1f} s" in text, where
        assert t not in last, where
