"""A whole study of tiny sequences: its files, its page, and that nothing is run twice."""

from __future__ import annotations

import csv
import html
import json
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.errors import MtpBenchError, UnknownNameError
from mtp_bench.running.options import RunOptions
from mtp_bench.running.stored import open_run, run
from mtp_bench.running.track_export import export_tracks
from mtp_bench.study import Study, study
from mtp_bench.study.causes import CAUSES
from mtp_bench.study.conduct import find, require_study_folder
from mtp_bench.study.figures import make_figures
from mtp_bench.study.gallery import command_of, picture_of, worst_moments
from mtp_bench.study.plan import make_plan, subject_of
from mtp_bench.study.relations import verdict
from mtp_bench.study.runs import Bench, library_files, open_bench
from mtp_bench.study.specs import make_tables
from mtp_bench.submission import load_submission
from mtp_bench.tables import to_json
from tests.support.browser import CHROMIUM, DRIVER, MISSING, chromium
from tests.support.command_line import CommandLine, write_submission
from tests.support.small_scenes import CARD, CARD_ID
from tests.test_readme import blocks

PAPERS = ("pasts", "targeted", "global", "speed", "frequency", "shared", "frames")
OURS = ("surface", "k_curve", "causes", "gaps", "since", "age", "bins", "budgets", "calibration", "cuts", "relations")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, repository: Path, card: str, kitti: str) -> Study:
    """The study of docs/visualization/study.md, of the small card; tests must not change its folder."""
    (block,) = blocks(repository / "docs" / "visualization" / "study.md", "python")
    folder = tmp_path_factory.mktemp("study")
    here = {'"MTP-Intersection-v0"': repr(card), '"study"': repr(str(folder)), "RunOptions(": f"RunOptions({kitti!r}, "}
    for shown, ours in here.items():
        assert block.count(shown) == 1, "the page names the env, the folder and the options once"
        block = block.replace(shown, ours)
    page: dict[str, Any] = {}
    exec(compile(block, "study.md", "exec"), page)
    result: Study = page["made"]
    return result


def rows_of(study: Study, name: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((study.folder / "tables" / f"{name}.json").read_text())["rows"]
    return found


@pytest.mark.parametrize("name", [*PAPERS, *OURS])
def test_every_table_is_written_twice_with_units_and_a_sentence(made: Study, name: str) -> None:
    content = json.loads((made.folder / "tables" / f"{name}.json").read_text())
    assert content["sentence"].endswith(".")
    lines = list(csv.reader((made.folder / "tables" / f"{name}.csv").read_text().splitlines()))
    units = {column["key"]: column["unit"] for column in content["columns"]}
    assert units.items() >= {key: "m" for key in units if "minADE" in key or key == "error"}.items()
    for line, row in zip(lines[1:], content["rows"], strict=True):
        values = [end for v in row.values() for end in (v if isinstance(v, list) else [v])]
        assert [cell for cell in line if cell] == [str(v) for v in values if v not in (None, "")]
    assert content["rows"]


def test_the_bar_of_every_agent_adds_up_to_its_error(made: Study) -> None:
    rows = rows_of(made, "causes")
    agents = {(row["agent"], row["H"]) for row in rows if row["targets_of"] == "all"}
    assert {("truth_past", 1), ("stp", 1), ("stp_same_budget", 1), ("stp_hedged", 1), ("mtp", 20)} <= agents
    for row in rows:
        assert sum(row[cause] for cause in CAUSES) == pytest.approx(row["error"], abs=1e-9), row["agent"]


def test_the_tables_say_what_compare_says(made: Study, cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    file = tmp_path / "compare.json"
    cli.ok("compare", "mtp", "--env", card, "--data", kitti, "--seeds", 1, "--jobs", 1, "--json", file)
    compared = {
        (row["agent"], row["hypotheses"], row["samples"]): row
        for row in json.loads(file.read_text())["rows"]
        if row["subset"] == "all"
    }
    checked = 0
    for row in rows_of(made, "global"):
        other = compared.get((row["agent"], row["H"], row["k"]))
        if other is not None:
            assert [row[n] for n in ("minADE", "minFDE", "error", "coverage")] == [
                other[n] for n in ("minADE", "minFDE", "error", "coverage")
            ]
            checked += 1
    assert checked >= 8


def test_every_figure_has_axes_with_units_n_and_a_sentence(made: Study) -> None:
    files = sorted((made.folder / "figures").glob("*.svg"))
    assert len(files) >= 15
    for file in files:
        root = ElementTree.fromstring(file.read_text())
        words = [text.strip() for text in root.itertext() if text.strip()]
        whole = " ".join(words)
        assert " n: " in whole, file.name
        assert re.search(r", (m|ms|%)\b|per (frame|trajectory)|\bk\b|probability|events|hypotheses H", whole), file.name
        assert file.with_suffix(".png").stat().st_size > 5000


def test_nothing_on_the_page_asks_anybody(made: Study) -> None:
    text = html.unescape(made.page.read_text())
    assert "default-src 'none'" in text
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)""", text)
    assert "<script" not in text
    assert not re.search(r"url\((?![\"']?#)", text)


def test_the_page_tells_the_whole_story(made: Study) -> None:
    text = made.page.read_text()
    for key in ("found", "cost", "often", "gain", "shared", "choose", "causes", "when", "decide", "made"):
        assert f'<section id="{key}">' in text
    for name in PAPERS:
        assert f"tables/{name}.csv" in text
    assert text.count("<svg") >= 15


def test_the_page_is_heard_as_well(made: Study) -> None:
    text = made.page.read_text()
    assert not re.search(r"<th(?! scope=)[ >]", text.split("<main>")[1])
    tables = [table.split("<tbody>")[1] for table in text.split("<table")[1:]]
    assert tables
    assert all(row.strip().startswith('<th scope="row"') for table in tables for row in table.split("<tr>")[1:])
    assert not re.search(r'<(div class="scroll"|pre)(?! tabindex="0" role="region" aria-label="[^"]+">)', text)
    assert not re.search(r'<figure class="wide"(?! tabindex="0" aria-label="[^"]+">)', text)
    names = re.findall(r'<svg role="img" aria-label="([^"]+)"', text)
    assert len(names) == text.count("<svg")
    assert all(len(name.split(". ", 1)) == 2 for name in names)


def test_nothing_is_run_twice(made: Study, tmp_path: Path, card: str, kitti: str) -> None:
    folder = tmp_path / "again"
    shutil.copytree(made.folder, folder)
    runs = sorted((folder / "runs").iterdir())
    before = {run: (run / "run.json").stat().st_mtime_ns for run in runs}
    broken = runs[0]
    next(broken.glob("*.npz")).unlink()
    again = make_tables(find(["mtp"], card, folder, RunOptions(kitti)))
    assert sorted((folder / "runs").iterdir()) == runs
    after = {run: (run / "run.json").stat().st_mtime_ns for run in runs}
    assert {run for run in runs if after[run] != before[run]} == {broken}
    for name in (*PAPERS, *OURS):
        if name not in ("speed", "surface", "relations"):  # which hold times
            assert json.loads(to_json(again[name]))["rows"] == rows_of(made, name), name


def test_other_detections_are_other_runs(made: Study, tmp_path: Path, card: str, kitti: str) -> None:
    root = tmp_path / "data"
    shutil.copytree(kitti, root)
    file = root / "kitti_tracking/detections/pointrcnn/Car/0001.txt"
    file.write_text("\n".join(file.read_text().splitlines()[1:]))  # one detection less
    plain, other = (RunOptions(str(where)) for where in (kitti, root))
    benches = [open_bench(card, tmp_path, options) for options in (plain, plain, other)]
    assert benches[0].content == benches[1].content != benches[2].content


def test_stored_runs_are_runs(made: Study, cli: CommandLine, card: str, kitti: str) -> None:
    folder = next(path for path in (made.folder / "runs").iterdir() if path.name.startswith("mtp-H20"))
    assert "mtp" in cli.ok("score", folder, "--data", kitti)


def test_the_command_on_an_agent_of_ones_own(cli: CommandLine, tmp_path: Path, card: str, kitti: str) -> None:
    """One run has one name in every table: its end with one hypothesis is the agent itself."""
    mine = write_submission(tmp_path / "mine", "mine", "[compare]\nends = {}", body="return empty_action(self._task)")
    folder = tmp_path / "out"
    given = "--env", card, "--data", kitti, "--agent", mine, "-o", folder, "--quick", "--jobs", 1
    said = cli.ok("study", *given)
    assert f"{folder / 'index.html'}" in said.replace("\n", "")
    assert f"mtp-bench study --env {card}" in html.unescape((folder / "index.html").read_text())
    told = json.loads((folder / "tables" / "global.json").read_text())["rows"]
    assert "mine" in {row["agent"] for row in told}
    assert "mtp" not in {row["agent"] for row in told}
    assert "mine" in {row["agent"] for row in json.loads((folder / "tables" / "pasts.json").read_text())["rows"]}


def test_simulated_traffic_is_studied_with_the_weights_that_ship(tmp_path: Path) -> None:
    found = find(["stp"], "MTP-Intersection-v0", tmp_path, RunOptions(scenes=1), quick=True)
    assert found.reference.frozen
    tables = make_tables(found)
    assert {"truth_past", "stp"} <= {row.agent for row in tables["causes"].rows}
    for row in tables["causes"].rows:
        assert sum(getattr(row, cause) for cause in CAUSES) == pytest.approx(row.error, abs=1e-9), row.agent
    moment = worst_moments(found)[0]
    assert moment.scene in found.bench.scenes
    assert picture_of(moment, "worst").png.startswith(b"\x89PNG")
    assert f"--scene {moment.scene}" in command_of(found, moment)


@pytest.mark.parametrize("more", [("--seeds", 2), ("--scenes", 7)])
def test_a_quick_study_is_quick(more: tuple[object, ...], cli: CommandLine, card: str, kitti: str) -> None:
    assert cli("study", "--env", card, "--data", kitti, "--quick", *more).status == 2


def test_an_agent_that_does_not_exist_is_named_before_anything_runs(tmp_path: Path, card: str, kitti: str) -> None:
    with pytest.raises(UnknownNameError, match="mpt"):
        study(["mpt"], card, tmp_path / "out", RunOptions(kitti))
    assert not (tmp_path / "out").exists()


def test_a_plan_runs_nothing_twice(card: str) -> None:
    plan = make_plan(["mtp", "stp"], load_card(card))
    names = [(s.submission.name, s.hypotheses, s.samples, s.observe) for s in plan.equal]
    assert names.count(("stp", 1, 4, "detections")) == 1


def test_the_ends_of_a_learned_agent_are_its_own(card: str) -> None:
    subject = subject_of(load_submission("mtp_modes"), load_card(card), (1, 5, 20), (20,))
    assert (subject.single.submission.name, subject.single.hypotheses) == ("mtp_modes", 1)
    assert (subject.truth.submission.name, subject.truth.observe) == ("mtp_modes", "truth")
    assert subject.equal[1] == subject.single
    assert sorted(subject.equal) == [1, 5, 20]
    assert sorted(subject.free) == [20]


def test_an_agent_whose_gap_begins_at_a_control_is_run_itself(card: str) -> None:
    subject = subject_of(load_submission("stp_cut"), load_card(card), (1, 5, 20), (20,))
    assert [setting.submission.name for setting in subject.equal.values()] == ["stp_cut"]
    assert (subject.end.submission.name, subject.own_ends) == ("stp", True)


def test_hypotheses_that_only_the_sweep_states_are_run(tmp_path: Path, card: str) -> None:
    stated = 'hypotheses = "hypotheses"\nsweep = { hypotheses = [2, 5] }\nends = "controls"'
    folder = write_submission(tmp_path / "swept", "swept", f"[compare]\n{stated}")
    agent = folder / "agent.py"
    agent.write_text(agent.read_text().replace("def build(task", "def build(task, hypotheses=1"))
    subject = subject_of(load_submission(folder), load_card(card), (1, 2, 5, 20), (5,))
    assert {count: s.submission.name for count, s in subject.equal.items()} == {1: "stp", 2: "swept", 5: "swept"}
    assert sorted(subject.free) == [5]


@pytest.mark.parametrize("held", ["notes.txt", "index.html", "tables"])
def test_a_study_overwrites_studies_alone(held: str, card: str, kitti: str, tmp_path: Path) -> None:
    (tmp_path / held).write_text("mine")
    with pytest.raises(MtpBenchError, match=f"holds '{held}', which is not of a study"):
        study(["mtp"], card, tmp_path, RunOptions(kitti))
    assert (tmp_path / held).read_text() == "mine"


def test_a_study_that_was_stopped_while_it_wrote_goes_on(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    require_study_folder(tmp_path)  # nothing is written yet
    (tmp_path / ".study").touch()
    (tmp_path / "index.html").write_text("of the study before")
    require_study_folder(tmp_path)


def test_a_study_of_nobody_is_an_error(card: str) -> None:
    with pytest.raises(MtpBenchError, match="name at least one"):
        make_plan([], load_card(card))


@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason=MISSING)
def test_in_a_browser_nothing_is_asked_for_and_nothing_is_cut_off(made: Study, tmp_path: Path) -> None:
    with chromium(tmp_path) as browser:
        for scheme in ("light", "dark"):
            browser.prefer(scheme)
            browser.forget()
            browser.open(made.page)
            for width in (390, 1600):
                browser.resize(width, 900)
                assert browser.script("return document.documentElement.scrollWidth") <= width
            assert browser.console() == []
            assert {a for a in browser.requests() if not a.startswith("data:")} == {made.page.as_uri()}
        ground = browser.script("return getComputedStyle(document.body).backgroundColor")
        browser.prefer("light")
        assert browser.script("return getComputedStyle(document.body).backgroundColor") != ground


def test_stored_tracks_are_studied_and_changed_ones_anew(tmp_path: Path, card: str, kitti: str) -> None:
    run("stp", card, tmp_path / "stp", RunOptions(kitti))
    export_tracks(open_run(tmp_path / "stp", kitti, card), tmp_path / "tracks")
    options = RunOptions(kitti, track_file=str(tmp_path / "tracks"))
    tables = make_tables(find(["given_tracks"], card, tmp_path / "out", options, quick=True))
    (row,) = [row for row in tables["global"].rows if row.agent == "given_tracks"]
    assert row.coverage is not None
    before = names_of_runs(tmp_path / "out", "given_tracks")
    assert len(before) == 1
    file = next((tmp_path / "tracks").rglob("0001.txt"))
    file.write_text("\n".join(file.read_text().splitlines()[1:]))  # one box less
    find(["given_tracks"], card, tmp_path / "out", options, quick=True)
    assert len(names_of_runs(tmp_path / "out", "given_tracks")) == 2


def names_of_runs(folder: Path, agent: str) -> list[str]:
    return [path.name for path in (folder / "runs").iterdir() if path.name.startswith(agent)]


def test_the_worst_events_can_be_opened(made: Study, cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    moments = worst_moments(made.findings)
    assert "lost" in {moment.incident.kind for moment in moments}  # detections are missing in two frames
    for kind in {moment.incident.kind for moment in moments}:
        costs = [moment.cost for moment in moments if moment.incident.kind == kind]
        assert costs == sorted(costs, reverse=True)
    moment = moments[0]
    words = shlex.split(command_of(made.findings, moment))
    picture = tmp_path / "event.png"
    cli.ok("view", words[2], *words[4:], "--png", picture)
    assert picture.stat().st_size > 1000
    assert sorted(path.name for path in (made.folder / "events").glob("*-focus.png"))
    first = moment.agents[0]
    assert (first.label, first.error is not None) == ("GT tracks", True)


CASES = {  # interval, limit, what the paper says, units -> verdict
    "all below": ((-2.0, -1.0), 0.0, -1, 9, "holds"),
    "all above": ((1.0, 2.0), 0.0, -1, 9, "does not hold"),
    "around": ((-1.0, 1.0), 0.0, -1, 9, "cannot be told"),
    "above is what it says": ((1.0, 2.0), 0.5, 1, 9, "holds"),
    "below is not": ((0.1, 0.4), 0.5, 1, 9, "does not hold"),
    "too few recordings": ((-2.0, -1.0), 0.0, -1, 5, "cannot be told"),
    "no interval": (None, 0.0, -1, 9, "cannot be told"),
}


@pytest.mark.parametrize("name", CASES)
def test_verdicts(name: str) -> None:
    interval, limit, sign, units, told = CASES[name]
    assert verdict(interval, limit, sign, np.ones(units)) == told


def test_the_papers_numbers_stand_beside_where_it_has_some(
    tmp_path: Path, kitti: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    env_id = "MTP-KITTI-noego-v0"
    path = tmp_path / f"{env_id}.toml"  # the tiny card under a name that the paper has numbers for
    path.write_text(CARD.replace(CARD_ID, env_id))
    found = find(["mtp"], str(path), tmp_path / "out", RunOptions(kitti), quick=True)
    assert found.bench.of_paper == "", "other scenes under the same name"
    monkeypatch.setattr(Bench, "of_paper", env_id)
    tables = make_tables(found)
    (shared,) = [row for row in tables["shared"].rows if (row.kind, row.H) == ("ids", 20)]
    assert (shared.paper_events_single, shared.paper_events_in_all) == (33, 9)
    assert shared.paper_fewer == pytest.approx(0.727, abs=1e-3)
    speed = {row.H: row.paper_tracking_rate for row in tables["speed"].rows}
    assert speed == {1: 207.4, 5: 65.2, 20: 8.1}
    past = {(row.targets_of, row.past): row.paper_minADE for row in tables["pasts"].rows}
    assert (past["IDS", "GT tracks"], past["FRAG", "tracklets"]) == (0.1, 1.621)
    told = {(row.targets_of, row.H, row.sampling): row.paper_minADE for row in tables["targeted"].rows if row.H == 20}
    assert (told["IDS", 20, "k of all"], told["IDS", 20, "none"]) == (0.747, 0.707)
    relations = {row.relation: row.paper for row in tables["relations"].rows}
    assert relations["Most switches are absent from at least one hypothesis"] == "33 to 9, 72.7% fewer"
    assert relations["Tracking slows down much with hypotheses"] == "207.4 to 8.1 frames/s"
    of_ten = replace(found, speed=tuple(replace(s, hypotheses=min(s.hypotheses, 10)) for s in found.speed))
    told_of_ten = {row.relation: row.paper for row in make_tables(of_ten)["relations"].rows}
    assert told_of_ten["Tracking slows down much with hypotheses"] == "", "the paper has no figures of 10 hypotheses"
    figure = make_figures(found, {"pasts": tables["pasts"]})["pasts"]
    assert "the paper's" in " ".join(ElementTree.fromstring(figure.svg).itertext())


def test_the_names_of_ends_say_what_differs_beside_the_hypotheses() -> None:
    card = load_card("MTP-Intersection-v0")
    subjects = {name: subject_of(load_submission(name), card, (1, 20), ()) for name in ENDS}
    assert {name: (subject.single.label, subject.end.label) for name, subject in subjects.items()} == ENDS
    for subject in subjects.values():
        assert subject.equal[1] == subject.single
    alone = subjects["mtp_modes_tracklets"]
    assert (alone.single.parameters["on"], alone.end.parameters["on"]) == ("tracklets", "truth")


ENDS = {
    "mtp": ("stp", "stp"),
    "stp_modes": ("stp_modes", "stp_modes"),
    "mtp_modes": ("mtp_modes, H = 1", "mtp_modes, H = 1"),
    "mtp_modes_tracklets": ("mtp_modes_tracklets, H = 1", "mtp_modes_tracklets, on = truth, H = 1"),
}


def test_runs_are_made_again_when_what_was_fitted_changes() -> None:
    files = set(library_files())
    assert {"prediction/presence_models/default.json", "tracking/detectors/megvii.toml", "tracks.py"} <= files
    assert {"env/environment.py", "running/run.py", "prediction/motion_noise/KITTI.toml"} <= files
    assert not [name for name in files if name.startswith(("viz/", "scoring/", "study/")) or name.endswith(".pyc")]
