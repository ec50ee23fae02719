"""A whole study of tiny sequences: its files, its page, and that no run is made twice."""

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

from docs.generate.studies import page_of
from mtp_bench.agent import load_submission
from mtp_bench.cards import load_card
from mtp_bench.core import to_json
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.running.options import RunOptions
from mtp_bench.running.stored import open_run, run
from mtp_bench.running.track_export import export_tracks
from mtp_bench.scoring.parts import PARTS
from mtp_bench.viz import Study, study
from mtp_bench.viz.studies.conduct import find
from mtp_bench.viz.studies.drawing import TEXTS
from mtp_bench.viz.studies.figures import FIGURES, make_figures
from mtp_bench.viz.studies.gallery import EACH
from mtp_bench.viz.studies.page import summary
from mtp_bench.viz.studies.plan import subject_of
from mtp_bench.viz.studies.relations import relation_rows, verdict
from mtp_bench.viz.studies.rows import make_tables
from mtp_bench.viz.studies.runs import Bench, EventCounts, count_events, library_files, open_bench
from tests.support.browser import chromium
from tests.support.command_line import CommandLine, write_submission
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene
from tests.test_readme import blocks

TABLES = set(TEXTS["tables"])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, repository: Path, card: str, kitti: str) -> Study:
    """The study of docs/visualization/study.md, of the small card; tests must not change its folder."""
    (block,) = blocks(repository / "docs" / "visualization" / "study.md", "python")
    folder = str(tmp_path_factory.mktemp("study"))
    here = {'"MTP-Intersection-v0"': repr(card), '"study"': repr(folder), "scenes=50": f"scenes=50, data={kitti!r}"}
    for shown, ours in here.items():
        assert block.count(shown) == 1, "the page names the env, the folder and the options once"
        block = block.replace(shown, ours)
    page: dict[str, Any] = {}
    exec(compile(block, "study.md", "exec"), page)
    result: Study = page["made"]
    return result


def rows_of(study: Study, name: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads((study.folder / "tables" / f"{name}.json").read_text())["rows"]
    return rows


def test_every_table_is_written_twice_with_units_and_a_sentence(made: Study) -> None:
    assert set(made.tables) >= TABLES
    for name in made.tables:
        content = json.loads((made.folder / "tables" / f"{name}.json").read_text())
        assert content["sentence"].endswith(".")
        assert "{" not in content["sentence"]
        units = {column["key"]: column["unit"] for column in content["columns"]}
        assert all(unit == "m" for key, unit in units.items() if "minADE" in key or key == "error")
        lines = list(csv.reader((made.folder / "tables" / f"{name}.csv").read_text().splitlines()))
        for line, row in zip(lines[1:], content["rows"], strict=True):
            values = [end for v in row.values() for end in (v if isinstance(v, list) else [v])]
            assert [cell for cell in line if cell] == [str(v) for v in values if v not in (None, "")]


def test_the_bar_of_every_agent_adds_up_to_its_error(made: Study) -> None:
    rows = rows_of(made, "parts")
    agents = {(row["agent"], row["H"]) for row in rows if row["targets_of"] == "all"}
    assert {("gt_tracks", 1), ("stp", 1), ("stp_same_samples", 1), ("stp_neighbours", 1), ("mtp", 20)} <= agents
    split = {row["agent"] for row in rows if row["cost_association"] is not None}
    assert split >= {"stp", "stp_same_samples", "mtp"}
    for row in rows:
        assert sum(row[f"cost_{part}"] or 0.0 for part in PARTS) == pytest.approx(row["error"], abs=1e-9), row["agent"]


def test_the_tables_equal_compare(made: Study, cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    file, names = tmp_path / "compare.json", ("minADE", "minFDE", "error", "coverage")
    cli.ok("compare", "mtp", "--env", card, "--data", kitti, "--seeds", 1, "--jobs", 1, "--json", file)
    rows = [row for row in json.loads(file.read_text())["rows"] if row["subset"] == "all"]
    compared = {(row["agent"], row["hypotheses"], row["samples"]): [row[n] for n in names] for row in rows}
    rows = [row for row in rows_of(made, "errors") if row["targets_of"] == "all"]
    ours = {(row["agent"], row["H"], row["k"]): [row[n] for n in names] for row in rows}
    both = ours.keys() & compared.keys()
    assert len(both) >= 8
    assert {key: ours[key] for key in both} == {key: compared[key] for key in both}


def test_the_page_tells_the_whole_story_and_loads_nothing(made: Study) -> None:
    text = made.page.read_text()
    assert made.findings.few, "two sequences: causes and moments come first, and no relation is shown"
    keys = ["found", "parts", "gallery", "cost", "often", "choose", "made"]
    assert re.findall(r'<section id="(\w+)">', text) == keys
    assert made.tables["relations"].title not in text
    (sentence,) = summary(made.findings)
    whose, causes = sentence.replace("\u00a0", " ").removeprefix("bADE of mtp is ").split(". By cause: ")
    sums = [int(part) for part in re.findall(r"[\w ]+ ([-−]?\d+) %", whose.partition(": ")[2])]
    assert sums == sorted(sums, reverse=True)
    assert sum(sums) == pytest.approx(100, abs=len(sums)), "each is rounded"
    assert "predictor" in causes
    captions = re.findall(r"<figcaption>([^<]*) <span", text)
    assert len(captions) == len(FIGURES)
    assert "95" not in "".join(captions)
    figure = (made.folder / "figures" / "parts.svg").read_text()
    assert "stp_bends" not in figure, "its error is not split"
    assert "not split (rest)" in figure
    for row in rows_of(made, "errors"):
        assert (row["p"], row["minADE_interval"]) == (None, None)
        assert "significantly" not in (row["no_gap_because"] or "")
    assert all(f"tables/{name}.csv" in text for name in TABLES - {"relations"})
    assert text.count("<svg") == len(FIGURES) == len(list((made.folder / "figures").glob("*.png")))
    plain = html.unescape(text)
    assert "default-src 'none'" in plain
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)|<script|url\((?!["']?#)""", plain)


@pytest.mark.parametrize("env", ["MTP-KITTI-v0", "MTP-Intersection-v0"])
def test_pages_of_the_site_show_no_recording(made: Study, env: str) -> None:
    text = made.page.read_text()
    ours = re.search(r"<h1>[^<]*<span>([^<]*)</span>", text)
    assert ours is not None
    assert "data:image" in text
    name, page = page_of(text.replace(ours[1], env))
    assert name == env
    assert ("data:image" in page, 'href="#gallery"' in page) == (env == "MTP-Intersection-v0",) * 2
    assert "tables/" not in page, "they are not on the site"
    assert made.folder.name + "/runs" in text
    assert made.folder.name + "/" not in page
    assert str(made.folder) not in page


def test_no_run_is_made_twice(made: Study, tmp_path: Path, card: str, kitti: str) -> None:
    folder = tmp_path / "again"
    shutil.copytree(made.folder, folder)
    root, file = tmp_path / "data", "kitti_tracking/detections/pointrcnn/Car/0001.txt"
    shutil.copytree(kitti, root)
    (root / file).write_text("\n".join((root / file).read_text().splitlines()[1:]))  # one detection less
    contents = {open_bench(card, tmp_path, RunOptions(data)).content for data in (kitti, str(root))}
    assert len(contents) == 2, "other detections are other runs"
    runs = sorted((folder / "runs").iterdir())
    before = {run: (run / "run.json").stat().st_mtime_ns for run in runs}
    broken = runs[0]
    next(broken.glob("*.npz")).unlink()
    again = make_tables(find(["mtp"], card, folder, RunOptions(kitti)))
    assert sorted((folder / "runs").iterdir()) == runs
    assert {run for run in runs if (run / "run.json").stat().st_mtime_ns != before[run]} == {broken}
    for name in TABLES:
        ours, before_it = json.loads(to_json(again[name]))["rows"], rows_of(made, name)
        for row in [*ours, *before_it]:
            row.pop("ms_per_frame", None)
        assert ours == before_it, name


def test_runs_are_made_again_when_code_or_fitted_files_change() -> None:
    files = set(library_files())
    assert {"tracks.py", "env/environment.py", "running/run.py"} <= files
    assert {"prediction/presence_models", "prediction/motion_noise"} <= {name.rpartition("/")[0] for name in files}
    assert not [name for name in files if name.startswith(("viz/", "scoring/", "study/")) or name.endswith(".pyc")]


def test_the_command_on_an_own_agent(made: Study, cli: CommandLine, tmp_path: Path, card: str, kitti: str) -> None:
    """One run has one name in every table: its reference with one hypothesis is the agent itself."""
    silent = "return empty_action(self._task)"
    mine = write_submission(tmp_path / "mine", "mine", "[compare]\ngap_references = {}", body=silent)
    folder = tmp_path / "out"
    given = "--env", card, "--data", kitti, "--agent", mine, "-o", folder, "--quick", "--jobs", 1
    assert f"{folder / 'index.html'}" in cli.ok("study", *given).replace("\n", "")
    assert f"mtp-bench study --env {card}" in html.unescape((folder / "index.html").read_text())
    agents = {name: {r["agent"] for r in rows_of(replace(made, folder=folder), name)} for name in ("errors", "parts")}
    assert "mine" in agents["errors"] & agents["parts"]
    assert "mtp" not in agents["errors"]
    stored = next(path for path in (made.folder / "runs").iterdir() if path.name.startswith("mtp-H20"))
    assert "mtp" in cli.ok("score", stored, "--data", kitti)


@pytest.mark.parametrize("name", ["notes.txt", "index.html", "tables"])
def test_a_study_overwrites_studies_alone(name: str, card: str, kitti: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(MtpBenchError, match=f"holds '{name}'"):
        study(["mtp"], card, tmp_path, RunOptions(kitti))
    assert (tmp_path / name).read_text() == "mine"


# ---- plans
SUBJECTS = {  # agent -> labels of one hypothesis and of the start of its gap, hypotheses with k samples and with all
    "mtp": ("stp", "stp", [1, 5, 20], [20]),
    "stp_min_score": ("stp", "stp", [1], []),
    "stp_modes": ("stp_modes", "stp_modes", [1], []),
    "mtp_modes": ("mtp_modes, H = 1", "mtp_modes, H = 1", [1, 5, 20], [20]),
    "mtp_modes_tracklets": ("mtp_modes_tracklets, H = 1", "mtp_modes_tracklets, on = truth, H = 1", [1, 5, 20], [20]),
}  # fmt: skip


@pytest.mark.parametrize("name", SUBJECTS)
def test_settings_of_an_agent(name: str) -> None:
    subject = subject_of(load_submission(name), load_card("MTP-Intersection-v0"), (1, 5, 20), (20,))
    assert (subject.single.label, subject.reference.label, list(subject.equal), list(subject.free)) == SUBJECTS[name]
    assert (subject.truth.submission.name == name, subject.truth.observe) == ("modes" in name, "truth")
    if name == "stp_min_score":  # its gap begins at a control
        assert subject.equal[1].label == "stp_min_score"
    else:
        assert subject.equal[1] == subject.single
    if name == "mtp_modes_tracklets":
        assert (subject.single.parameters["on"], subject.reference.parameters["on"]) == ("tracklets", "truth")


# ---- the page in a browser, stored tracks, events
@pytest.mark.needs("browser")
def test_in_a_browser_no_request_is_made_and_nothing_is_cut_off(made: Study, tmp_path: Path) -> None:
    with chromium(tmp_path) as browser:
        grounds = set()
        for scheme in ("light", "dark"):
            browser.prefer(scheme)
            browser.forget()
            browser.open(made.page)
            for width in (390, 1600):
                browser.resize(width, 900)
                assert browser.script("return document.documentElement.scrollWidth") <= width
            assert browser.console() == []
            assert {a for a in browser.requests() if not a.startswith("data:")} == {made.page.as_uri()}
            grounds.add(browser.script("return getComputedStyle(document.body).backgroundColor"))
        assert len(grounds) == 2


def test_stored_tracks_are_studied_and_changed_ones_anew(tmp_path: Path, card: str, kitti: str) -> None:
    run("stp", card, tmp_path / "stp", RunOptions(kitti))
    export_tracks(open_run(tmp_path / "stp", kitti, card), tmp_path / "tracks")
    options = RunOptions(kitti, tracks=str(tmp_path / "tracks"))
    tables = make_tables(find(["given_tracks"], card, tmp_path / "out", options, quick=True))
    (row,) = [row for row in tables["errors"].rows if (row.agent, row.targets_of) == ("given_tracks", "all")]
    assert row.coverage is not None
    assert len(list((tmp_path / "out" / "runs").glob("given_tracks*"))) == 1
    file = next((tmp_path / "tracks").rglob("0001.txt"))
    file.write_text("\n".join(file.read_text().splitlines()[1:]))  # one box less
    find(["given_tracks"], card, tmp_path / "out", options, quick=True)
    assert len(list((tmp_path / "out" / "runs").glob("given_tracks*"))) == 2


def test_the_worst_moments_can_be_opened(made: Study, cli: CommandLine, tmp_path: Path) -> None:
    pictures = sorted((made.folder / "moments").iterdir(), key=lambda path: int(path.name.split("-")[0]))
    causes = [path.stem.split("-", 1)[1].replace("-", " ") for path in pictures]
    assert set(causes) <= set(PARTS.values()) - {"below threshold"}
    assert max(map(causes.count, causes)) <= EACH
    assert causes == sorted(causes, key=causes.index), "of one cause after the other"
    assert all(path.stat().st_size > 1000 for path in pictures)
    commands = re.findall(r"<figcaption><code>(.*?)</code>", made.page.read_text())
    assert len(commands) == len(pictures)
    words = shlex.split(html.unescape(commands[0]))
    cli.ok("view", words[2], *words[4:], "--png", tmp_path / "moment.png")
    assert (tmp_path / "moment.png").stat().st_size > 1000


# ---- relations
VERDICTS = {  # interval, limit, sign of the paper, units -> verdict
    "all below": ((-2.0, -1.0), 0.0, -1, 9, "holds"),
    "all above": ((1.0, 2.0), 0.0, -1, 9, "does not hold"),
    "around": ((-1.0, 1.0), 0.0, -1, 9, "cannot be told"),
    "above as expected": ((1.0, 2.0), 0.5, 1, 9, "holds"),
    "below against it": ((0.1, 0.4), 0.5, 1, 9, "does not hold"),
    "too few recordings": ((-2.0, -1.0), 0.0, -1, 5, "cannot be told"),
    "no interval": (None, 0.0, -1, 9, "cannot be told"),
}


@pytest.mark.parametrize("name", VERDICTS)
def test_verdicts(name: str) -> None:
    interval, limit, sign, units, expected = VERDICTS[name]
    assert verdict(interval, limit, sign, np.ones(units)) == expected


def test_the_papers_numbers_stand_beside_ours(made: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Bench, "of_paper", "MTP-KITTI-noego-v0")
    findings = made.findings
    tables = make_tables(findings)
    shared = {row.H: row.paper_events for row in tables["events"].rows if row.kind == "ids"}
    assert (shared[1], shared[20]) == (33, 9)
    errors = {(row.targets_of, row.agent, row.H, row.sampling): row.paper_minADE for row in tables["errors"].rows}
    assert (errors["IDS", "gt_tracks", 1, "–"], errors["FRAG", "stp", 1, "–"]) == (0.1, 1.621)
    assert (errors["IDS", "mtp", 20, "k of all"], errors["IDS", "mtp", 20, "none"]) == (0.747, 0.707)
    papers = {row.relation: row.paper for row in relation_rows(findings)}
    assert papers["Most switches are absent from at least one hypothesis"] == "33 to 9, 72.7% fewer"
    figure = make_figures(findings, {"errors": tables["errors"]})["cost"]
    assert "the paper's" in " ".join(ElementTree.fromstring(figure.svg).itertext())


def test_events_of_one_hypothesis_are_shared_by_all() -> None:
    # a car whose track changes its name in frame 3, and is gone in frame 5
    ids = [7, 7, 7, 8, 8, None, 8, 8, 8, 8]
    tracks = [[] if i is None else [Thing(i, 0, 0)] for i in ids]
    found = count_events(make_scene([[Thing(1, 0, 0)]] * 10), make_rollout(tracks), make_card(samples=1))
    counts = {"ids": 1, "lost": 1, "reacquired": 1, "frag": 2}
    assert found == EventCounts(own=counts, shared=counts, objects=1, frames=10)
