"""The leaderboard as a page, as tables and as JSON, from records made up for it."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.records import OldResult, Record, save_record
from mtp_bench.scoring import SUBSETS
from mtp_bench.viz.board import Entry, Found, board_json, board_notes, board_page, board_tables, entries_of
from mtp_bench.viz.board.columns import percent
from mtp_bench.viz.board.scale import BAR, MOST_TICKS, PAD, WIDTH, bar_of, scale_of, scene_chart
from tests.support.board_records import HOSTILE, LEVELS_OF, board_of, made_up, made_up_board
from tests.support.command_line import CommandLine, on_terminal, read_json
from tests.support.stored_records import hidden_part, signed_level

MOST_BYTES = 300_000  # of a page without records
OTHER = "MTP-nuScenes-mini-v0"
LINKS = [f"records/{i}.json" for i in range(13)]
EARLIER = OldResult(
    path=Path("x"), definitions="1.0", submission="stp", env="MTP-nuScenes-v0", split="train", error=4.745,
    interval=(4.48, 5.01), coverage=0.769, made="2026-11-20",
)  # fmt: skip


class Page(HTMLParser):
    """Tags with their attributes, and cells of the entries by key."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.entries: list[dict[str, str]] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.tags.append((tag, found))
        if tag == "tbody" and "entry" in (found.get("class") or "").split():
            self.entries.append({"class": found["class"] or ""})
        elif tag in ("td", "th") and "data-key" in found:
            self.entries[-1][found["data-key"] or ""] = found["data-value"] or ""

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def entries() -> list[Entry]:
    return board_of(*made_up_board(), links=LINKS, added="late_decider", levels=LEVELS_OF)


@pytest.fixture(scope="module")
def html(entries: list[Entry]) -> str:
    return board_page(entries)


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def test_entries_stand_by_rank_and_the_unranked_below_by_error(entries: list[Entry]) -> None:
    first = [(entry.name, entry.rank) for entry in entries if entry.env == "MTP-WILDTRACK-k10-v0"]
    assert first == [
        ("braided_paths", 1),
        ("forest_of_maybe", 1),
        ("calm_hedge", 3),
        ("late_decider", 4),
        ("stp", 5),
        ("straight_on", 6),
        ("truth_past", None),
        ("pooled_many", None),
        ("short_of_breath", None),
        ("sleeper", None),
    ]


def test_every_unranked_entry_says_why(entries: list[Entry]) -> None:
    assert {entry.name: entry.why for entry in entries[:10] if entry.rank is None} == {
        "truth_past": "saw the truth",
        "pooled_many": "open division: rank 1 there",
        "short_of_breath": "partial: 3 of 4 scenes",
        "sleeper": "crashed: the process ended by signal 9",
    }


def test_what_cannot_be_compared_with_most_is_not_ranked() -> None:
    old = made_up("old", 0.5, scorer={"definitions": "0.9"})
    entries = board_of(made_up("a", 0.8), made_up("b", 0.9), old)
    assert [(entry.name, entry.rank) for entry in entries] == [("a", 1), ("b", 2), ("old", None)]
    assert entries[-1].why == "scored by definitions 0.9, today's are 2.0"


def test_too_few_recordings_are_said_once_above_the_table(html: str, entries: list[Entry]) -> None:
    reason = "too few recordings to rank: 3.9 effective units, fewer than 6"
    assert [entry.rank for entry in entries[10:]] == [None] * 3
    assert [entry.name for entry in entries[10:]] == ["braided_paths", "stp", "calm_hedge"]  # by error
    assert f"<span><b>{reason}</b></span>" in html
    assert f'class="why"><bdi>{reason}' not in html


def test_hidden_scenes_rank_and_the_public_error_stands_beside(tmp_path: Path) -> None:
    records = [made_up("knows", 0.5, "MTP-Merge-v0"), made_up("honest", 0.6, "MTP-Merge-v0")]
    errors = {"knows": 1.2, "honest": 0.8}
    found = [
        Found(
            record,
            signed=signed_level(
                record, "hidden", hidden_part(*[errors[record.submission.name]] * 50), retired="2030-03-03"
            ),
        )
        for record in records
    ]
    entries = entries_of(found)
    assert [(entry.name, entry.rank) for entry in entries] == [("honest", 1), ("knows", 2)]
    assert [entry.error for entry in entries] == pytest.approx([0.8, 1.2])
    assert [entry.public_error for entry in entries] == pytest.approx([0.6, 0.5])
    assert board_notes(entries) == [["hidden scenes of seal first of 2030-01-01, retired 2030-03-03"]]
    html = board_page(entries)
    assert "</svg>hidden</span>" in html
    assert "2030-02-02 by tester; seal first of 2030-01-01, retired 2030-03-03" in html
    (row, _) = board_json(entries)["MTP-Merge-v0"]
    assert (row["level"], row["public"]) == ("hidden", pytest.approx(0.6))
    (alone,) = entries_of([Found(records[0])])
    assert (alone.rank, alone.why, alone.public_error) == (None, "not scored on hidden scenes yet", None)


def gaps(*records: Record) -> dict[str, float | None]:
    return {entry.name: entry.standing.gaps.get("all") for entry in board_of(*records)}


def test_the_gap_closed_comes_from_the_records_of_both_ends() -> None:
    ends = made_up("stp", 1.0), made_up("truth_past", 0.4, env={"observe": "truth"})
    found = gaps(*ends, made_up("a", 0.7), made_up("b", 1.6, status="partial"))
    assert found == {"stp": 0.0, "truth_past": 1.0, "a": pytest.approx(0.5), "b": None}
    assert gaps(ends[0], made_up("a", 0.7)) == {"a": None, "stp": None}


def test_a_gap_between_other_data_or_no_gap_at_all_is_not_closed() -> None:
    stp, other = made_up("stp", 1.0), made_up("truth_past", 0.4, env={"data_manifest": "00" * 32})
    assert gaps(stp, made_up("a"), other) == {"stp": None, "a": None, "truth_past": None}
    assert gaps(stp, made_up("truth_past", 1.0, env={"observe": "truth"})) == {"stp": None, "truth_past": None}


def test_the_gap_with_the_same_predictor_is_known_where_the_controls_have_it() -> None:
    ends = made_up("stp", 1.0), made_up("truth_past", 0.4, env={"observe": "truth"})
    other = made_up("learned", 0.7, submission={"ends": "own"})
    found = {entry.name: entry.same_predictor_gap("all") for entry in board_of(*ends, made_up("a", 0.7), other)}
    assert found == {"stp": 0.0, "truth_past": 1.0, "a": pytest.approx(0.5), "learned": None}


def test_cells_hold_what_they_are_sorted_by(page: Page) -> None:
    first, stp, crashed = page.entries[0], page.entries[4], page.entries[9]
    assert (first["rank"], first["name"], first["error"], first["level"]) == ("1", "braided_paths", "0.742", "2")
    assert (stp["hypotheses"], stp["samples"], stp["p50"], stp["p95"], stp["memory"]) == (
        "1",
        "20",
        "2.4",
        "4.9",
        "224",
    )
    assert (crashed["rank"], crashed["error"], crashed["ids"]) == ("", "", "")
    assert float(first["reacquired"]) == pytest.approx(1.8 * float(first["error"]), rel=0.01)  # weighed otherwise


def test_every_column_can_be_sorted_and_states_what_is_better(page: Page) -> None:
    better = {b["data-key"]: b.get("data-better") for b in page.all("button") if "data-key" in b}
    assert set(better) == set(page.entries[0]) - {"class"}
    assert {key for key, value in better.items() if value == "higher"} == {"coverage", "gap", "level"}
    assert better["error"] == better["ids"] == better["p95"] == better["memory"] == "lower"


def test_unranked_and_added_entries_are_marked(page: Page) -> None:
    kinds = [entry["class"].split()[1:] for entry in page.entries[:10]]
    assert kinds == [[], [], [], ["added"], [], [], *[["unranked"]] * 4]


def test_a_shared_rank_a_badge_and_the_reason_show(html: str) -> None:
    assert html.count('class="tie"') == 2
    assert all(f"</svg>{level}</span>" in html for level in ("scored", "re-scored", "re-run"))
    assert "the process ended by signal 9" in html
    assert 'href="./records/0.json"' in html


def test_equal_entries_give_equal_bytes(html: str) -> None:
    assert (
        board_page(board_of(*made_up_board()[::-1], links=LINKS[::-1], added="late_decider", levels=LEVELS_OF)) == html
    )


def test_the_page_needs_nothing_else(html: str, page: Page) -> None:
    for tag, attributes in page.tags:
        assert not {"src", "srcset", "style", "action", "onclick"} & attributes.keys(), tag
    assert {link["href"] for link in page.all("link")} == {"data:,"}
    assert not re.search(r"https?://|@import|url\(", html)
    (policy,) = [meta["content"] for meta in page.all("meta") if meta.get("http-equiv")]
    assert policy is not None
    assert policy.startswith("default-src 'none'; style-src 'sha256-")
    assert "unsafe" not in policy


def test_an_empty_board_says_how_to_take_part() -> None:
    html = board_page([])
    assert len(html.encode()) < MOST_BYTES
    assert "No record under definitions 2.0 yet" in html
    for command in ("new", "check", "submit", "board --with"):
        assert f"<code>mtp-bench {command}" in html
    assert Page(html).entries == []
    assert "not comparable" not in html


def test_results_under_earlier_definitions_are_a_plain_table_without_ranks(entries: list[Entry], html: str) -> None:
    page = board_page(entries, [(EARLIER, "history/1.0/stp/x.json")])
    assert "Results under definitions 1.0: not ranked, not comparable" in page
    assert 'href="./history/1.0/stp/x.json"' in page
    assert "<td>4.745</td><td>4.480 – 5.010</td><td>77 %</td><td><bdi>2026-11-20</bdi></td>" in page
    assert Page(page).entries == Page(html).entries


HOSTILE_TEXTS = [HOSTILE, "<!--", "\u2028", '" onmouseover="window.hacked=1', "{{ 7 * 7 }}", "'><svg/onload=hacked()>"]


@pytest.mark.parametrize("text", HOSTILE_TEXTS)
def test_what_people_write_is_text(text: str) -> None:
    sums = {subset: [3.0] for subset in SUBSETS}
    hostile = made_up(
        "hostile",
        submission={"authors": [text], "description": text},
        training_data=[text],
        status="partial",
        status_reason=text,
        missed={"reasons": {text: text}},
        env={"split": text},
        reference={"origin": text},
        scorer={"definitions": text},
        measured={"hardware": {"cpu": text, "gpu": text}},
        details={text: text},
        per_scene=[{"scene": text, "weight": sums, "error": sums}],
    )
    harmless = board_page(board_of(made_up("a", status="partial", status_reason="b")))
    old = EARLIER.model_copy(update={"definitions": text, "submission": text, "env": text, "split": text, "made": text})
    html = board_page(board_of(hostile, made_up("b"), links=[text, None]), [(old, text)])
    page = Page(html)
    assert len(page.all("script")) == 1
    assert {tag for tag, _ in page.tags} <= {tag for tag, _ in Page(harmless).tags} | {"a", "ul", "li", "nav"}
    for _, attributes in page.tags:
        assert not [name for name in attributes if name.startswith("on")]
    assert "49" not in re.findall(r"<bdi>(.*?)</bdi>", html)


@pytest.mark.parametrize("link", ["javascript:alert(1)", " javascript:alert(1)", "data:text/html,x", "//host/x", "a b"])
def test_a_link_is_never_a_script(link: str) -> None:
    (address,) = [a["href"] for a in Page(board_page(board_of(made_up("a"), links=[link]))).all("a")]
    assert address is not None
    assert ":" not in address
    assert " " not in address
    assert address.startswith("./")


def test_an_old_record_is_marked_and_an_unknown_env_has_no_summary() -> None:
    html = board_page(board_of(made_up("a", env_id="MTP-Nowhere-v0", scorer={"definitions": "0.1"})))
    assert "old scorer" in html
    assert "Licence:" not in html


def test_the_scale_holds_the_ranked_and_the_reference() -> None:
    ranked = board_of(made_up("a", 0.71, spread=0.01), made_up("b", 0.93, spread=0.01))
    scale = scale_of(ranked, 1.21)
    assert scale is not None
    assert scale.low <= 0.70
    assert scale.high >= 1.21
    assert len(scale.ticks) <= MOST_TICKS + 1
    assert scale.x(scale.low) == PAD
    assert scale.x(scale.high) == WIDTH - PAD
    off = bar_of(scale, 3.0, (2.5, 3.5))
    assert off is not None
    assert off.above
    assert not off.below
    assert off.at == WIDTH - PAD


@pytest.mark.parametrize("error", [0.0, 1e-9, 1e6, 0.5])
def test_a_single_point_has_a_scale_too(error: float) -> None:
    scale = scale_of(board_of(made_up("a", error, spread=0.0)), None)
    assert scale is not None
    assert scale.low <= error <= scale.high
    assert scale.low < scale.high
    assert 1 <= len(scale.ticks) <= MOST_TICKS + 1


def test_one_entry_far_off_leaves_the_scale_to_the_others() -> None:
    scale = scale_of(board_of(made_up("a", 0.7), made_up("b", 0.8), made_up("c", 90.0)), None)
    assert scale is not None
    assert scale.high < 2.0


def test_without_a_number_there_is_no_scale() -> None:
    assert scale_of(board_of(made_up("a", None)), 1.0) is None
    assert bar_of(None, 1.0, None) is None


def test_bars_of_scenes_share_a_scale_with_the_reference() -> None:
    first, second = board_of(made_up("a", 0.5), made_up("stp", 1.0))
    bars = scene_chart(first, second)
    assert [bar.scene for bar in bars[:2]] == ["wildtrack-1200", "wildtrack-1400"]
    assert max(bar.reference or 0.0 for bar in bars) == BAR
    assert all(bar.width < BAR for bar in bars)
    assert all(bar.reference is None for bar in scene_chart(second, second))


@pytest.mark.parametrize(("share", "text"), [(-0.004, "0 %"), (-0.006, "−1 %"), (0.499, "50 %"), (1.0, "100 %")])
def test_shares_are_whole_percentages(share: float, text: str) -> None:
    assert percent(share) == text


def test_what_saying_nothing_scores_stands_above_the_table() -> None:
    known, unknown = made_up("one", 1.0, silence=2.0), made_up("two", 2.0)
    outside = made_up("one", 1.0, silence=2.0, division="open")
    assert "saying nothing scores <b>2.000</b>" in board_page(board_of(known))
    assert "saying nothing scores 2.000" in str(board_tables(board_of(known))[0].title)
    for entries in (board_of(unknown), board_of(outside)):
        assert "saying nothing" not in board_page(entries)
        assert "saying nothing" not in str(board_tables(entries)[0].title)


def test_tables_of_the_terminal(entries: list[Entry]) -> None:
    first, second = board_tables(entries)
    assert first.row_count == 10
    assert second.row_count == 3
    assert list(first.columns[0].cells)[3] == "late_decider (added)"
    assert [note for note in board_notes(entries)[0] if "truth" in note] == ["not ranked (saw the truth): truth_past"]


def test_markup_and_escapes_do_not_reach_the_terminal() -> None:
    (notes,) = board_notes(board_of(made_up("a", None, status="partial", status_reason="[red]a\x1b[2J")))
    assert notes == ["not ranked (partial: [red]a�[2J): a"]


def test_json_holds_what_the_tables_show(entries: list[Entry]) -> None:
    content = board_json(entries)
    assert list(content) == ["MTP-WILDTRACK-k10-v0", "MTP-WILDTRACK-v0"]
    row = content["MTP-WILDTRACK-k10-v0"][6]
    assert (row["submission"], row["rank"], row["not_ranked_because"]) == ("truth_past", None, "saw the truth")
    assert row["error"] == pytest.approx(0.381)
    assert len(row["interval"]) == 2


def write_records(folder: Path, *records: Record) -> list[Path]:
    paths = []
    for record in records:
        path = folder / record.submission.name / f"{record.env.id}.json"
        save_record(record, path)
        paths.append(path)
    return paths


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A folder of records, and a record elsewhere."""
    write_records(
        tmp_path / "records",
        made_up("good", 0.5),
        made_up("poor", 1.5),
        made_up("other", env_id="MTP-nuScenes-mini-v0"),
    )
    (mine,) = write_records(tmp_path / "my own", made_up("mine", 0.9))
    return tmp_path / "records", mine


def test_the_command_prints_ranks_and_writes_a_page(files: tuple[Path, Path], tmp_path: Path, cli: CommandLine) -> None:
    records, mine = files
    page, content = tmp_path / "out.html", tmp_path / "out.json"
    out = cli.ok("board", "--records", records, "--with", mine, "-o", page, "--json", content)
    assert "mine (added)" in out
    assert "4 records" in out
    rows: dict[str, list[dict[str, Any]]] = read_json(content)
    assert [(r["submission"], r["rank"], r["added"]) for r in rows["MTP-WILDTRACK-k10-v0"]] == [
        ("good", 1, False),
        ("mine", 2, True),
        ("poor", 3, False),
    ]
    links = [a["href"] for a in Page(page.read_text()).all("a")]
    assert "./my%20own/mine/MTP-WILDTRACK-k10-v0.json" in links
    assert "./records/good/MTP-WILDTRACK-k10-v0.json" in links


def test_nothing_is_cut_off_at_80_columns(tmp_path: Path) -> None:
    write_records(tmp_path, *(record for record in made_up_board() if record.per_scene))
    printed = on_terminal(80, "board", "--records", tmp_path)
    assert not [line for line in printed if "refused" in line]
    assert max(map(len, printed)) <= 80
    assert not [line for line in printed if "…" in line]
    row = next(line for line in printed if line.startswith("forest_of_maybe"))
    assert " ".join(row.split()) == "forest_of_maybe 1 0.744 [0.690, 0.797] 1.16 1.35 47 % 22.9 scored"


def test_the_command_shows_one_env_and_the_same_record_once(files: tuple[Path, Path], cli: CommandLine) -> None:
    records, _ = files
    out = cli.ok(
        "board",
        "--records",
        records,
        "--env",
        "MTP-nuScenes-mini-v0",
        "--with",
        records / "other/MTP-nuScenes-mini-v0.json",
    )
    assert "MTP-WILDTRACK-k10-v0" not in out
    assert out.count("other") == 1
    assert "added" not in out


def test_an_env_without_a_record_is_no_error_but_an_unknown_one_is(files: tuple[Path, Path], cli: CommandLine) -> None:
    records, _ = files
    assert "no record of MTP-Merge-v0 yet" in cli.ok("board", "--records", records, "--env", "MTP-Merge-v0")
    assert "unknown environment 'MTP-Nerge-v0'" in cli("board", "--records", records, "--env", "MTP-Nerge-v0").error


def test_the_command_names_a_missing_folder_and_a_broken_record(tmp_path: Path, cli: CommandLine) -> None:
    assert "no such folder of records" in cli("board", "--records", tmp_path / "none").error
    (path,) = write_records(tmp_path / "records", made_up("a"))
    path.write_text(path.read_text().replace("Ada Fiction", "Someone Else"))
    write_records(tmp_path / "records", made_up("sound"))
    said = cli.ok("board", "--records", tmp_path / "records")
    assert "refused: " in said
    assert "it was changed after it was made" in " ".join(said.split())
    assert "sound" in said
    strict = cli("board", "--records", tmp_path / "records", "--strict").error
    assert strict.startswith("1 record refused, the first: ")
    assert "it was changed after it was made" in cli("board", "--with", path, "--records", tmp_path).error


def test_a_page_that_cannot_be_written_is_refused_before(tmp_path: Path, cli: CommandLine) -> None:
    assert "there is no folder" in cli("board", "-o", tmp_path / "none" / "x.html").error
