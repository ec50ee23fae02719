"""The leaderboard as a page, as tables and as JSON, from records made up for it."""

import csv
import io
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent.loader import ON_SCORED
from mtp_bench.core import to_text
from mtp_bench.core.errors import MtpBenchError, RecordError
from mtp_bench.judge import FileEntry, Record, read_file_entries
from mtp_bench.judge.records.targets import UnitTargets
from mtp_bench.scoring import DEFINITIONS, paired_difference
from mtp_bench.scoring.definitions import KNOWN_SUBSETS
from mtp_bench.viz.board.columns import board_json
from mtp_bench.viz.board.drawings import MAX_TICKS, PAD, WIDTH, bar_of, scale_of
from mtp_bench.viz.board.entries import Entry, LinkedRecord, entries_of
from mtp_bench.viz.board.page import BoardFiles, board_files, parts_folder, write_board
from mtp_bench.viz.board.tables import board_tables
from tests.support.board_records import HOSTILE, LEVELS_OF, board_of, made_up, made_up_board
from tests.support.command_line import CommandLine, on_terminal, read_json
from tests.support.stored_records import hidden_part, save_record, signed_level

MAIN, FEW = "MTP-WILDTRACK-k10-v0", "MTP-WILDTRACK-v0"
LINKS = [f"records/{i}.json" for i in range(13)]


class Page(HTMLParser):
    """Tags with their attributes, and the texts of the cells of the entries by the key of their column."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.entries: list[dict[str, str]] = []
        self._columns: list[str] = []
        self._cell = -1
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.tags.append((tag, found))
        if tag == "table":
            self._columns, self._cell = [], -1
        elif tag == "tbody" and "entry" in (found.get("class") or "").split():
            self.entries.append({"id": found["id"] or "", "class": found["class"] or ""})
            self._cell = -1
        elif tag == "tbody":
            self._cell = len(self._columns)  # a heading between entries
        elif tag == "button" and "aria-describedby" in found:
            self._columns.append((found["aria-describedby"] or "").removeprefix("_about-"))
        elif tag in ("td", "th") and found.get("class") != "chart":
            self._cell += 1

    def handle_endtag(self, tag: str) -> None:
        if tag == "tbody":
            self._cell = -1

    def handle_data(self, data: str) -> None:
        if self.entries and 0 <= self._cell < len(self._columns) and self.tags[-1][0] not in ("style", "script"):
            cell = self.entries[-1]
            key = self._columns[self._cell]
            cell[key] = f"{cell.get(key, '')} {data}".strip()

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


PIECE = re.compile(r'mtpBoard\((".*?"), (".*")\);')


def pieces_of(files: BoardFiles, env_id: str = MAIN) -> dict[str, str]:
    """The pieces of HTML that the file of an environment hands to the page, by key."""
    lines = files.parts[f"{env_id}.js"].splitlines()
    return {json.loads(piece[1]): json.loads(piece[2]) for line in lines if (piece := PIECE.fullmatch(line))}


@pytest.fixture(scope="module")
def entries() -> list[Entry]:
    return board_of(*made_up_board(), links=LINKS, added="late_decider", levels=LEVELS_OF)


@pytest.fixture(scope="module")
def files(entries: list[Entry]) -> BoardFiles:
    return board_files(entries)


@pytest.fixture(scope="module")
def html(files: BoardFiles) -> str:
    return files.page


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def test_entries_stand_by_error_and_the_unranked_below_by_error(entries: list[Entry]) -> None:
    first = [(entry.name, entry.place) for entry in entries if entry.env == MAIN]
    ranked = ("braided_paths", "forest_of_maybe", "calm_hedge", "late_decider", "stp", "straight_on")
    others = ("gt_tracks", "pooled_many", "sleeper", "short_of_breath")  # the last is partial
    assert first == [*((name, 1 + i) for i, name in enumerate(ranked)), *((name, None) for name in others)]


def test_too_few_recordings_are_said_once_above_the_table(html: str, entries: list[Entry]) -> None:
    reason = "too few recordings to rank: 3.9 effective units, fewer than 6"
    assert [entry.place for entry in entries[:3]] == [None] * 3
    assert [entry.name for entry in entries[:3]] == ["braided_paths", "stp", "calm_hedge"]  # by error
    assert f"<b>No ranks</b>: <bdi>{reason}</bdi>. Lowest bADE: " in html
    assert f'class="why"><bdi>{reason}' not in html


def test_a_table_begins_with_the_best_how_sure_that_is_and_what_runs_it() -> None:
    weights = {"networks": {"modes-truth-MTP-KITTI-v0.safetensors": "0" * 64}}
    records = made_up("stp", 1.0), made_up("good", 0.502), made_up("first", 0.5, submission=weights)
    (answer,) = re.findall(r'<p class="answer">(.*?)</p>', board_files(board_of(*records)).page)
    assert re.sub("<.*?>", "", answer) == (
        "Best: first, 0.500 m, significantly better than 1 of 2 others. Not significantly worse: good. "
        "Runs after mtp-bench train predictor modes --env MTP-KITTI-v0 --on truth (about 1 min): "
        f"mtp-bench compare first --env {MAIN}."
    )


def test_a_table_states_k_horizon_c_and_budgets_of_its_card_and_what_used_the_truth(html: str) -> None:
    """The budgets are forecasts per frame where only targets are known."""
    settings = [re.sub("<.*?>", "", line) for line in re.findall(r'class="about">(bADE here.*?)</p>', html)]
    assert [line.split("horizon")[0].strip() for line in settings] == [
        f"bADE here: k = {k} samples per object," if k > 1 else "bADE here: k = 1 sample per object," for k in (1, 10)
    ]
    assert all("c = 4 m. Budgets of false forecasts: up to " in line for line in settings)
    targets = made_up("stp", env_id="MTP-nuScenes-v0", env={"truth_complete": False})
    frames = "Budgets of false forecasts: 20, 40, 50 forecasts per live frame, as false ones are not known"
    assert frames in board_files(board_of(targets)).page
    headings = re.findall(r'<tbody class="heading" data-of="(\w+)">.*?>([^<>]+)</th>', html)
    assert headings == [("reference", "References that used the truth: not ranked"), ("other", "Others: not ranked")]


def test_hidden_scenes_rank_and_the_public_error_stands_beside(tmp_path: Path) -> None:
    records = [made_up("knows", 0.5, "MTP-Merge-v0"), made_up("honest", 0.6, "MTP-Merge-v0")]
    parts = [hidden_part(*[error] * 50) for error in (1.2, 0.8)]
    levels = [
        signed_level(record, "hidden", part, retired="2030-03-03") for record, part in zip(records, parts, strict=True)
    ]
    entries = entries_of([LinkedRecord(*pair) for pair in zip(records, levels, strict=True)])
    assert [(entry.name, entry.place) for entry in entries] == [("honest", 1), ("knows", 2)]
    assert [entry.error for entry in entries] == pytest.approx([0.8, 1.2])
    assert [entry.public_error for entry in entries] == pytest.approx([0.6, 0.5])
    ((_, notes),) = board_tables(entries)
    assert notes == [
        "level hidden (run again, and on scenes that were not public)",
        "hidden scenes of seal first of 2030-01-01, retired 2030-03-03",
    ]
    files = board_files(entries)
    (first, second) = Page(files.page).entries
    assert (first["level"], first["public"], second["public"]) == ("hidden by tester", "0.600", "0.500")
    details = pieces_of(files, "MTP-Merge-v0")["MTP-Merge-v0/honest"]
    assert "2030-02-02 by tester; seal first of 2030-01-01, retired 2030-03-03" in details
    (row, _) = board_json(entries)["MTP-Merge-v0"]
    assert row["level"] == "hidden"
    assert row["public"] == pytest.approx(0.6)
    (alone,) = entries_of([LinkedRecord(records[0])])
    assert (alone.place, alone.why, alone.public_error) == (None, "not scored on hidden scenes yet", None)


def test_rows_hold_numbers_levels_and_reasons(page: Page, html: str, files: BoardFiles, entries: list[Entry]) -> None:
    first, stp = page.entries[3], page.entries[7]
    assert (first["rank"], first["error"], first["level"]) == ("1 (1–2)", "0.742", "re-run by tester")
    assert (first["difference"], stp["difference"]) == ("−0.326", "–")
    assert float(first["paper_ids_minADE"]) == pytest.approx(1.5 * float(first["minADE"]), abs=0.01)
    difference = entries[3].difference
    assert difference is not None
    assert difference.interval is not None
    low, high = difference.interval
    assert low < difference.mean < high < 0
    assert difference.mean == pytest.approx(0.742 - 1.068)
    assert entries[3].verdict == "better"
    assert html.count("(1–2)</span></td>") == html.count('entry first"') == 2
    assert html.count("3/4 scenes") == 2  # beside its name and in the overview
    assert all(f"</svg>{level}<" in html for level in ("scored", "re-scored", "re-run"))
    assert "the process ended by signal 9" in html
    assert 'href="./records/0.json"' in pieces_of(files)[f"{MAIN}/braided_paths"]


def test_every_column_is_explained_and_states_what_is_better(page: Page) -> None:
    explained = {d.get("id") for d in page.all("dd")}
    buttons = [button for button in page.all("button") if "aria-describedby" in button]
    assert {button["aria-describedby"] for button in buttons} <= explained
    better = {(b["aria-describedby"] or "").removeprefix("_about-"): b.get("data-better") for b in buttons}
    assert {key for key, value in better.items() if value == "higher"} == {"coverage", "same_gap", "level"}
    assert {"error", "difference", "ids", "ms"} <= better.keys()
    assert all("scope" in th or "chart" in (th.get("class") or "") for th in page.all("th"))


def test_equal_entries_give_equal_bytes(files: BoardFiles) -> None:
    again = board_of(*made_up_board()[::-1], links=LINKS[::-1], added="late_decider", levels=LEVELS_OF)
    assert board_files(again) == files


def test_the_page_needs_no_network(html: str, page: Page) -> None:
    for tag, attributes in page.tags:
        assert not {"src", "srcset", "style", "action", "onclick"} & attributes.keys(), tag
    (icon,) = page.all("link")
    assert (icon["href"] or "").startswith("data:image/svg+xml,")
    assert not re.search(r"https?://|@import|url\(", html.replace("http://www.w3.org/2000/svg", ""))
    (policy,) = [meta["content"] for meta in page.all("meta") if meta.get("http-equiv")]
    assert policy is not None
    assert policy.startswith("default-src 'none'; style-src 'sha256-")
    assert not any(text in policy for text in ("unsafe", "script-src 'self'"))


def test_what_was_trained_on_scored_scenes_is_said_where_ranks_are_shown() -> None:
    """In the row, by a mark in the overview, in the files, and in the terminal; nowhere else."""
    note = f"predictor {ON_SCORED}"
    knows = made_up("knows", 0.5, training_data=["nuScenes: split train", note])
    entries = board_of(made_up("stp", 1.0), knows)
    files = board_files(entries)
    assert (re.findall(r'<span class="why"><bdi>(.*?)</bdi>', files.page), files.page.count("0.50†")) == ([note], 1)
    assert files.page.count("†") == 2  # the cell, and what the mark means
    rows = json.loads(files.parts[f"{MAIN}.json"])["rows"]
    assert {row["submission"]: row["trained_on_scored"] for row in rows} == {"knows": note, "stp": None}
    assert f"{note}: knows" in board_tables(entries)[0][1]
    assert "†" not in board_files(board_of(made_up("stp", 1.0))).page


def test_the_overview_has_the_papers_environments_first_and_marks_simulated_ones() -> None:
    envs = ["MTP-Merge-v0", "MTP-Own-v0", FEW, MAIN]
    entries = board_of(*(made_up("stp", 1.0, env_id=env_id) for env_id in envs))
    html = board_files(entries).page
    heads = re.findall(r'<th scope="col"(?: class="made")?><a href="#([^"]+)">', html)
    assert heads == [FEW, MAIN, "MTP-Own-v0", "MTP-Merge-v0"]
    groups = re.findall(r'colspan="(\d)"><span>(recorded|simulated)</span>', html)
    assert groups == [("3", "recorded"), ("1", "simulated")]
    assert html.index(f'href="#{MAIN}/stp"') < html.index('href="#MTP-Merge-v0/stp"')
    assert html.count('<span class="tag">simulated</span>') == 1


def test_environments_with_a_map_are_in_no_order_with_the_others() -> None:
    lanes = "MTP-Intersection-Lanes-v0"
    records = [made_up(name, error, env_id=env) for name, error, env in (("a", 1.0, lanes), ("b", 0.9, lanes))]
    entries = board_of(made_up("a", 0.5), *records)
    files = board_files(entries)
    overviews = (re.findall(r'class="name"><bdi>(\w)</bdi>', part) for part in files.page.split("<h2 id="))
    assert [names for names in overviews if names] == [["a"], ["b", "a"]]
    assert files.page.count("these ranks compare with no others") == files.page.count(">road map</span>") == 1
    notes = [notes for table, notes in board_tables(entries) if table.name == lanes]
    assert any("see lanes" in note for note in notes[0])


def test_turning_targets_are_a_column_that_older_records_leave_blank() -> None:
    old, new = made_up("old", 1.0), made_up("new", 1.1, subsets=KNOWN_SUBSETS)
    files = board_files(board_of(old, new))
    rows = {row["submission"]: row for row in json.loads(files.parts[f"{MAIN}.json"])["rows"]}
    assert (rows["new"]["turning"], rows["old"]["turning"]) == (pytest.approx(1.54, rel=0.01), None)
    assert (rows["old"]["place"], rows["new"]["place"]) == (1, 2)  # their rows of other subsets compare
    assert "turning" in pieces_of(files)[f"{MAIN}/new"]
    assert "turning" in to_text(board_tables(board_of(old, new))[0][0])
    assert "turning" not in board_files(board_of(old)).parts[f"{MAIN}.csv"]


def test_energy_score_and_calibration_stand_beside_the_error() -> None:
    files = board_files(board_of(made_up("calibrated", 0.5, brier=0.0625, overconfidence=0.075), made_up("plain", 1.0)))
    lines = {entry["id"].partition("/")[2]: entry for entry in Page(files.page).entries}
    assert (lines["calibrated"]["energy_score"], lines["calibrated"]["brier"]) == ("0.50", "0.062")
    assert lines["plain"]["brier"] == "–"
    rows = {row["submission"]: row for row in json.loads(files.parts[f"{MAIN}.json"])["rows"]}
    assert rows["calibrated"]["overconfidence"] == pytest.approx(0.075)
    assert rows["calibrated"]["energy_score"] == pytest.approx(0.5)
    assert rows["plain"]["overconfidence"] is None
    pieces = pieces_of(files)
    assert "Brier score 0.062; stated less true +0.075</dd>" in pieces[f"{MAIN}/calibrated"]
    assert "Brier score" not in pieces[f"{MAIN}/plain"]


def test_every_table_is_a_csv_and_a_json_file(files: BoardFiles, entries: list[Entry], html: str) -> None:
    rows = list(csv.DictReader(io.StringIO(files.parts[f"{MAIN}.csv"])))
    assert [row["submission"] for row in rows] == [entry.name for entry in entries[3:]]
    assert float(rows[0]["difference [m]"]) == pytest.approx(0.742 - 1.068)
    assert float(rows[0]["difference_interval_low"]) < float(rows[0]["difference [m]"])
    listed = [row | {"env": None} for row in json.loads(files.parts[f"{MAIN}.json"])["rows"]]
    assert listed == [row | {"env": None} for row in json.loads(json.dumps(board_json(entries)))[MAIN]]
    assert len(json.loads(files.parts["leaderboard.json"])["rows"]) == 13
    for path in (f"{MAIN}.csv", f"{FEW}.json", "leaderboard.csv", "leaderboard.json"):
        assert f'href="index.parts/{path}"' in html
        assert path in files.parts


def test_two_entries_of_one_name_have_addresses_of_their_own() -> None:
    one, other = made_up("a", 0.5), made_up("a", 0.6, submission={"digest": "0" * 64})
    files = board_files(board_of(one, other))
    ids = [entry["id"] for entry in Page(files.page).entries]
    assert len(set(ids)) == 2
    assert f"{MAIN}/a" in ids
    assert set(ids) == pieces_of(files).keys()


def test_parts_are_replaced_as_a_whole_and_nothing_else_ever_is(tmp_path: Path) -> None:
    page = tmp_path / "my page.html"
    write_board(page, board_files(board_of(made_up("a"), made_up("b")), folder=parts_folder(page).name))
    write_board(page, board_files(board_of(made_up("a")), folder=parts_folder(page).name))
    assert sorted(path.name for path in parts_folder(page).rglob("*.js")) == [f"{MAIN}.js"]
    assert 'data-parts="my%20page.parts"' in page.read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["my page.html", "my page.parts"]
    theirs = tmp_path / "theirs.parts"
    theirs.mkdir()
    (theirs / "precious.txt").touch()
    with pytest.raises(MtpBenchError, match=r"precious\.txt.*a page did not write"):
        write_board(tmp_path / "theirs.html", board_files([]))
    assert (theirs / "precious.txt").exists()


HOSTILE_TEXTS = [HOSTILE, "<!--", "\u2028", '" onmouseover="window.hacked=1', "{{ 7 * 7 }}", "'><svg/onload=hacked()>"]


@pytest.mark.parametrize("text", HOSTILE_TEXTS)
def test_what_people_write_is_text(text: str) -> None:
    hostile = made_up(
        "hostile", submission={"authors": [text], "description": text}, training_data=[text],
        missed={"reasons": {text: f"rejected: {text}"}}, env={"split": text, "keywords": {text: text}},
        reference={"origin": text}, scorer={"definitions": text}, measured={"hardware": {"cpu": text}},
    )  # fmt: skip
    targets = hostile.targets.model_dump() | {"scenes": [text, "b", "c", "d"]}
    hostile = hostile.model_copy(update={"targets": UnitTargets.model_validate(targets)})
    harmless = board_files(board_of(made_up("a", missed={"reasons": {"a|0": "rejected: b"}})))
    files = board_files(board_of(hostile, made_up("b"), links=[text, None]))
    assert len(Page(files.page).all("script")) == 1
    known = {tag for html in html_of_all(harmless) for tag, _ in Page(html).tags}
    for html in html_of_all(files):
        assert {tag for tag, _ in Page(html).tags} <= known | {"a", "ul", "li"}
        for _, attributes in Page(html).tags:
            assert not [name for name in attributes if name.startswith("on")]
        assert "49" not in re.findall(r"<bdi>(.*?)</bdi>", html)
    for name, part in files.parts.items():
        assert not name.endswith(".js") or (part.isascii() and "</" not in part and "<!" not in part)


def html_of_all(files: BoardFiles) -> list[str]:
    return [files.page, *(html for html in pieces_of(files).values())]


@pytest.mark.parametrize("link", ["javascript:alert(1)", " javascript:alert(1)", "data:text/html,x", "//host/x", "a b"])
def test_a_link_is_never_a_script(link: str) -> None:
    details = pieces_of(board_files(board_of(made_up("a"), links=[link])))[f"{MAIN}/a"]
    (address,) = [a["href"] for a in Page(details).all("a") if not (a["href"] or "").startswith("#")]
    assert address is not None
    assert not any(text in address for text in (":", " "))
    assert address.startswith("./")


def test_the_scale_of_differences_holds_the_ranked_and_zero() -> None:
    scale = scale_of(board_of(made_up("stp", 1.2), made_up("a", 0.9), made_up("b", 0.8)))
    assert scale is not None
    assert scale.low <= -0.4
    assert scale.high >= 0.0
    assert len(scale.ticks) <= MAX_TICKS + 1
    assert (scale.x(scale.low), scale.x(scale.high)) == (PAD, WIDTH - PAD)
    off = bar_of(scale, paired_difference([2.5, 3.5] * 4, [0.0] * 8, [1.0] * 8))
    assert off is not None
    assert off["above"]
    assert not off["below"]
    assert off["at"] == WIDTH - PAD


def write_records(folder: Path, *records: Record) -> list[Path]:
    paths = []
    for record in records:
        path = folder / record.submission.name / f"{record.env.id}.json"
        save_record(record, path)
        paths.append(path)
    return paths


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    records = made_up("good", 0.5), made_up("poor", 1.5), made_up("other", env_id="MTP-nuScenes-mini-v0")
    write_records(tmp_path / "records", *records)
    (mine,) = write_records(tmp_path / "my own", made_up("mine", 0.9))
    return tmp_path / "records", mine


def test_the_command_prints_and_writes_a_page(folders: tuple[Path, Path], tmp_path: Path, cli: CommandLine) -> None:
    records, mine = folders
    page, content = tmp_path / "out.html", tmp_path / "out.json"
    out = cli.ok("board", "--records", records, "--with", mine, "-o", page, "--json", content)
    assert all(text in out for text in ("mine (added)", "4 records"))
    assert shown_rows(content) == [("good", 1, False), ("mine", 2, True), ("poor", 3, False)]
    details = (tmp_path / "out.parts" / f"{MAIN}.js").read_text()
    assert "./my%20own/mine/MTP-WILDTRACK-k10-v0.json" in details
    assert "./records/good/MTP-WILDTRACK-k10-v0.json" in details
    (again,) = write_records(tmp_path / "again", made_up("poor", 0.2))
    cli.ok("board", "--records", records, "--with", again, "--json", content)
    assert shown_rows(content) == [("poor", 1, True), ("good", 2, False)], "side by side they would count twice"


def shown_rows(content: Path) -> list[tuple[Any, ...]]:
    return [(row["submission"], row["place"], row["added"]) for row in read_json(content)[MAIN]]


def test_nothing_is_cut_off_at_80_columns(tmp_path: Path) -> None:
    write_records(tmp_path, *made_up_board())
    printed = on_terminal(80, "board", "--records", tmp_path)
    assert not [line for line in printed if "refused" in line]
    assert max(map(len, printed)) <= 80
    assert not [line for line in printed if "…" in line]
    row = next(line for line in printed if line.startswith("forest_of_maybe"))
    assert "* p<.05" in next(line for line in printed if line.startswith("agent")), "what the star means"
    assert " ".join(row.split()) == "forest_of_maybe 1–2 0.744 0.690–0.797 −0.324* 1.16"
    assert any(line.startswith("short_of_breath (3/4 scenes)") for line in printed)


def test_the_command_shows_one_env_and_the_same_record_once(folders: tuple[Path, Path], cli: CommandLine) -> None:
    records, _ = folders
    (records / "good" / f"{MAIN}.json").write_text("broken")
    mini = "MTP-nuScenes-mini-v0"
    out = cli.ok("board", "--records", records, "--env", mini, "--with", records / "other" / f"{mini}.json", "--strict")
    assert sum("other" in line for line in out.splitlines()) == 1
    assert not any(text in out for text in (MAIN, "added"))


def test_missing_folders_and_broken_records(tmp_path: Path, cli: CommandLine, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "no such folder of records" in cli("board", "--records", tmp_path / "none").error
    (path,) = write_records(tmp_path / "records", made_up("a"))
    path.write_text(path.read_text().replace('"observe":"detections"', '"observe":"perfect"'))
    (sound,) = write_records(tmp_path / "records", made_up("sound"))
    shutil.copy(sound, tmp_path / "records" / "MTP-PETS-v0.json")
    for options in ((), ("--env", "MTP-PETS-v0")):
        refused = cli.ok("board", "--records", tmp_path / "records", *options)
        said = f"MTP-PETS-v0.json: holds a record on {MAIN}, expected MTP-PETS-v0"
        assert said.replace(" ", "") in "".join(refused.split())  # lines are wrapped
    (tmp_path / "records" / "MTP-PETS-v0.json").unlink()
    printed = cli.ok("board", "--records", tmp_path / "records")
    assert all(text in printed for text in ("refused: ", "sound"))
    strict = cli("board", "--records", tmp_path / "records", "--strict").error
    assert strict.startswith("1 record refused, the first: ")
    monkeypatch.setattr("mtp_bench.commands.board.bundled", lambda kind: tmp_path / "wheel" / kind)  # without records
    monkeypatch.chdir(tmp_path)
    assert "leaderboard/records: no such folder of records" in cli("board").error
    write_records(tmp_path / "leaderboard" / "records", made_up("here"))
    assert "here" in cli.ok("board")
    monkeypatch.setattr("mtp_bench.commands.board.record_paths", lambda *_: pytest.fail("all records were read before"))
    assert "perfect" in cli("board", "--with", path, "--records", tmp_path).error


ENTRY: dict[str, Any] = {
    "env": FEW, "name": "their <b>model</b>", "bADE": 2.5144, "interval": [2.3, 2.7], "sha256": "0123456789ab" + "f" * 52,
    "form": "vad", "modes": 6, "horizon_s": 3.0, "least_confidence": 0.2, "definitions": DEFINITIONS,
}  # fmt: skip


def file_entries(folder: Path, *changes: dict[str, Any]) -> list[FileEntry]:
    """The entries of a folder with a file per change of `ENTRY`."""
    folder.mkdir(exist_ok=True)
    for number, change in enumerate(changes):
        (folder / f"{number}.json").write_text(json.dumps(ENTRY | change))
    return read_file_entries(folder)


def test_forecasts_of_files_stand_last_in_a_section_without_ranks(tmp_path: Path, files: BoardFiles) -> None:
    assert "read from a file" not in files.page
    assert read_file_entries(tmp_path / "none") == []
    shown = file_entries(tmp_path, {}, {"env": "MTP-KITTI-v0", "bADE": 9.0, "definitions": "2.0"})
    page = board_files(board_of(made_up("stp")), file_entries=shown)
    section = page.page.partition('<h2 id="_files">')[2].partition("</section>")[0]
    text = re.sub("<.*?>", "|", section)
    assert "Forecasts read from a file" in text
    assert "Never ranked: not verified, may have seen the future and the labels." in text
    lines = [[cell for cell in line.split("|") if cell] for line in text.splitlines() if "0123" in line]
    kitti, few = lines
    assert few == [
        "their &lt;b&gt;model&lt;/b&gt;", FEW, "2.514 [2.300, 2.700]", "0123456789ab", "vad", "6", "3", "0.2",
    ]  # fmt: skip
    assert kitti[1:3] == ["MTP-KITTI-v0", "9.000 [2.300, 2.700] (definitions 2.0)"]
    assert page.parts == board_files(board_of(made_up("stp"))).parts, "no table of ranks has them"


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"sha256": "0123"}, "sha256"),
        ({"bADE": -1.0}, "bADE"),
        ({"interval": [1.0]}, "interval"),
        ({"place": 1}, "place"),
        ({"least_confidence": 1.5}, "least_confidence"),
    ],
)
def test_a_broken_entry_of_a_file_is_refused(tmp_path: Path, change: dict[str, Any], problem: str) -> None:
    with pytest.raises(RecordError, match=rf"0\.json.*{problem}"):
        file_entries(tmp_path, change)


def test_the_page_reads_entries_of_files_beside_the_records(cli: CommandLine, tmp_path: Path) -> None:
    save_record(made_up("stp"), tmp_path / "records" / "stp" / f"{MAIN}.json")
    command = ("board", "--records", tmp_path / "records", "-o", tmp_path / "index.html")
    cli.ok(*command)
    before = (tmp_path / "index.html").read_text()
    file_entries(tmp_path / "files", {})
    cli.ok(*command)
    after = (tmp_path / "index.html").read_text()
    assert ("_files" in before, '<h2 id="_files">' in after) == (False, True)
    assert after.partition('<section class="overview" aria-labelledby="_files">')[0] in before
