"""Pages of results: figures from records made up for it, against values by hand; claims; marks; files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mtp_bench.errors import MtpBenchError, RecordError, UnknownNameError
from mtp_bench.records import Record, load_record, record_paths, save_record
from mtp_bench.scoring.statistics import paired_interval
from mtp_bench.viz.results import Known, fill
from mtp_bench.viz.results.blocks import filled
from mtp_bench.viz.results.conditions import (
    Condition,
    above,
    all_of,
    below,
    chance,
    claim,
    significant,
    verdict,
    within,
)
from mtp_bench.viz.results.figure import Figure, p_text, signed
from mtp_bench.viz.results.figures import Figures
from mtp_bench.viz.results.table import Tables, cell, label, markdown
from mtp_bench.viz.results.templates import functions_of, render
from tests.support.board_records import MAIN, made_up
from tests.support.command_line import CommandLine
from tests.support.stored_records import SIMULATED, hidden_part, ships_of, signed_level, write_record

ENV = "MTP-Small-v0"
TRUTH = (1.0, 2.0, 1.0, 2.0, 1.0, 2.0, 1.0, 2.0)  # m, of eight units of ten targets: 1.5 m
STP = tuple(error + 2.0 for error in TRUTH)
CONTROL = tuple(error + 1.5 for error in TRUTH)
MTP = tuple(error + 0.5 for error in TRUTH)
NOISY = tuple(error + shift for error, shift in zip(STP, (1, -1) * 4, strict=True))  # as STP, but for chance


def records(**mtp: Any) -> list[Record]:
    return [
        write_record(*TRUTH, name="truth_past", env={"observe": "truth"}),
        write_record(*STP, name="stp", silence=10.0),
        write_record(*CONTROL, name="stp_same_budget"),
        write_record(*MTP, name="mtp", measured={"ms_per_frame": 3.25}, **mtp),
        write_record(*NOISY, name="stp_hedged", submission={"ends": "own"}),
    ]


def known_of(*found: Record) -> Known:
    return Known(found, ships=ships_of(*found))


@pytest.fixture(scope="module")
def known() -> Known:
    return known_of(*records())


@pytest.fixture(scope="module")
def figures(known: Known) -> Figures:
    return Figures(known)


def test_figures_of_one_agent_are_those_of_its_record(figures: Figures) -> None:
    assert figures.error("mtp", ENV).value == 2.0
    assert figures.error("mtp", ENV, "lost").value == 2.0
    low, high = figures.error("mtp", ENV).interval or (0.0, 0.0)
    assert low < 2.0 < high
    for figure in (figures.plain, figures.min_ade, figures.min_fde):
        assert str(figure("stp", ENV)) == "3.50 m"
    assert str(figures.missed("stp", ENV)) == "1.05 m"  # .3 of the error in such records
    assert str(figures.coverage("stp", ENV)) == "100 %"
    assert str(figures.ms("mtp", ENV)) == "3.2 ms"
    assert str(figures.silence(ENV)) == "10.00 m"


def test_counts_are_those_of_the_subset(figures: Figures) -> None:
    counts = (figures.targets, figures.objects, figures.scenes, figures.units)
    assert [str(count(ENV)) for count in counts] == ["80", "40", "8", "8.0"]
    assert [str(count(ENV, "lost")) for count in counts] == ["16", "5", "8", "8.0"]


def test_differences_have_interval_and_p(figures: Figures) -> None:
    found = figures.difference("mtp", "stp_same_budget", ENV)
    assert (found.value, found.interval, found.p) == (-1.0, (-1.0, -1.0), 2 / 2**8)
    gain = figures.gain("mtp", "stp_same_budget", ENV)
    assert (gain.value, gain.interval, gain.p) == (1.0, (1.0, 1.0), 2 / 2**8)
    assert gain.sure == "1.00 m (1.00 to 1.00, p = 0.008)"
    nothing = figures.difference("stp_hedged", "stp", ENV)
    assert (nothing.value, nothing.p) == (0.0, 1.0)
    hedged, plain = ([10 * error for error in errors] for errors in (NOISY, STP))
    assert nothing.interval == paired_interval(hedged, plain, [10.0] * 8)


def test_gaps_lie_between_their_ends(figures: Figures) -> None:
    gap = figures.gap("mtp", ENV)
    assert gap.value == pytest.approx(0.75)
    assert gap.sure == "75 % (75 to 75 %)"
    assert figures.gap("stp", ENV).value == 0.0
    assert figures.gap("truth_past", ENV).value == 1.0
    assert figures.gap("stp_same_budget", ENV, end="mtp").value == pytest.approx(1 / 3)  # of what mtp gains
    assert figures.has_gap(ENV)
    assert not figures.has_gap(ENV, start="stp_hedged", end="stp")
    with pytest.raises(RecordError, match="stp_hedged is not significantly worse than stp"):
        figures.gap("mtp", ENV, start="stp_hedged", end="stp")


def test_the_same_predictor_gap_needs_ends_with_its_predictor(figures: Figures) -> None:
    assert figures.same_predictor_gap("mtp", ENV) == figures.gap("mtp", ENV)
    assert figures.has_same_predictor_gap("mtp", ENV)
    assert not figures.has_same_predictor_gap("stp_hedged", ENV)
    with pytest.raises(RecordError, match="gap closed with the same predictor of stp_hedged on MTP-Small-v0"):
        figures.same_predictor_gap("stp_hedged", ENV)


def changed_row(record: Record, subset: str, **changed: Any) -> Record:
    rows = [row.model_copy(update=changed) if row.subset == subset else row for row in record.rows]
    return record.model_copy(update={"rows": rows})


def test_ends_that_were_run_with_a_submission_are_told_of() -> None:
    own = write_record(*MTP, name="mtp", submission={"ends": "own"})
    known = {"gap_closed_same_predictor": 0.4, "gap_same_predictor_interval": (0.3, 0.5)}
    found = Figures(known_of(*records()[:2], changed_row(own, "all", **known)))
    assert found.has_same_predictor_gap("mtp", ENV)
    assert found.same_predictor_gap("mtp", ENV).sure == "40 % (30 to 50 %)"
    assert found.gap("mtp", ENV).value == pytest.approx(0.75)


def test_the_ends_of_a_network_are_the_records_with_it() -> None:
    with_network = {"ends": "own", "networks": {"modes-tracklets-MTP-X-v0.safetensors": "0" * 64}}
    own = write_record(*MTP, name="mine", submission=with_network)
    ends = [write_record(*STP, name="stp_modes"), write_record(*TRUTH, name="truth_modes", env={"observe": "truth"})]
    found = Figures(known_of(*records(), own, *ends))
    expected = found.gap("mine", ENV, "all", "stp_modes", "truth_modes")
    assert found.same_predictor_gap("mine", ENV) == expected
    assert not Figures(known_of(*records(), own)).has_same_predictor_gap("mine", ENV)


def test_events_are_those_of_the_record() -> None:
    found = Figures(known_of(changed_row(write_record(*STP, name="stp"), "lost", events=54.333)))
    assert str(found.events(ENV, "lost")) == "54"
    with pytest.raises(RecordError, match=r"events of stp on MTP-Small-v0 \(all\): its record has no such number"):
        found.events(ENV, "all")


def test_gaps_of_other_numbers_of_samples_do_not_compare() -> None:
    with pytest.raises(RecordError, match="20, 4, 4 samples per object, expected one k"):
        Figures(known_of(*records(samples=20))).gap("mtp", ENV)


def test_ratios(figures: Figures) -> None:
    ratio = figures.ratio(figures.min_ade("stp", ENV), figures.min_ade("truth_past", ENV))
    assert str(ratio) == "2.3 times"
    times = figures.times("stp", "mtp", ENV)
    assert times.value == pytest.approx(3.5 / 2.0)
    low, high = times.interval or (0.0, 0.0)
    assert low < 1.75 < high
    with pytest.raises(RecordError, match="the second is 0"):
        figures.ratio(ratio, Figure("nothing", 0.0))


def test_ranks_and_why_there_is_none(figures: Figures) -> None:
    assert [str(figures.rank(name, ENV)) for name in ("mtp", "stp_same_budget", "stp")] == ["1", "2", "3"]
    assert figures.ranked("stp", ENV)
    assert not figures.ranked("truth_past", ENV)
    with pytest.raises(RecordError, match=r"rank of truth_past on MTP-Small-v0 \(all\): none \(saw the truth\)"):
        figures.rank("truth_past", ENV)
    assert figures.why_unranked(ENV) == ""
    assert figures.why_unranked(ENV, "lost") == "shown only"


def test_the_papers_figures_stand_for_its_environments(figures: Figures) -> None:
    assert str(figures.paper("stp", "MTP-nuScenes-v0", "paper_ids").to(3)) == "8.345 m"
    assert str(figures.paper("mtp", "MTP-nuScenes-v0", "paper_frag", hypotheses=10).to(3)) == "9.585 m"
    with pytest.raises(RecordError, match="the paper has none"):
        figures.paper("stp", "MTP-nuScenes-v0", "reacquired")


def test_the_order_of_agents_on_two_environments() -> None:
    errors = {"truth_past": 0.5, "stp": 1.0, "stp_same_budget": 0.9, "mtp": 0.8, "ab3dmot": 1.1}
    other = {**errors, "ab3dmot": 0.85}  # better than two that are better on the first
    figures = Figures(
        Known(
            [
                made_up(name, error, env, env={"observe": "truth" if name == "truth_past" else "detections"})
                for env, table in (("MTP-PETS-v0", errors), ("MTP-KITTI-v0", other))
                for name, error in table.items()
            ]
        )
    )
    assert sorted(figures.agents("MTP-PETS-v0", "MTP-KITTI-v0")) == ["ab3dmot", "mtp", "stp", "stp_same_budget"]
    found = figures.agreement("MTP-PETS-v0", "MTP-KITTI-v0")
    assert found.value == pytest.approx((4 - 2) / 6)
    assert found.ranged.startswith("0.33 [")
    assert figures.plain_agreement("MTP-PETS-v0", "MTP-KITTI-v0").ranged == "0.33"
    with pytest.raises(RecordError, match="agreement of order"):
        figures.agreement("MTP-PETS-v0", "MTP-nuScenes-v0")


def test_a_figure_that_a_record_has_not(figures: Figures) -> None:
    with pytest.raises(RecordError, match=r"^error of stp on MTP-Small-v0 \(ids\): its record has no such number"):
        figures.error("stp", ENV, "ids")


def test_missing_records_and_misspelt_names(figures: Figures, known: Known) -> None:
    assert known.has("mtp", ENV)
    assert known.has(["mtp", "stp"], ENV)
    assert not known.has(["mtp", "affinity"], ENV)
    assert known.present(["affinity", "stp"], ENV) == ["stp"]
    pairs = [("here", ENV), ("there", "MTP-nuScenes-v0")]
    assert known.complete(pairs, ["mtp", "stp"]) == pairs[:1]
    with pytest.raises(RecordError, match=r"^no record of 'affinity' on MTP-Small-v0: make it with `mtp-bench submit`"):
        figures.error("affinity", ENV)
    with pytest.raises(UnknownNameError, match=r"unknown agent 'mpt': did you mean 'mtp'\?"):
        known.has("mpt", ENV)
    with pytest.raises(UnknownNameError, match="unknown environment 'MTP-Smal-v0'"):
        known.has("mtp", "MTP-Smal-v0")
    with pytest.raises(UnknownNameError, match="unknown subset 'idss'"):
        figures.error("mtp", ENV, "idss")


def test_records_of_other_conditions_are_not_used() -> None:
    old = write_record(*MTP, name="mtp", scorer={"definitions": "0.9"})
    found = known_of(write_record(*STP, name="stp"), old)
    assert not found.has("mtp", ENV)
    with pytest.raises(RecordError, match="the record of 'mtp' on MTP-Small-v0 cannot be used: scored by definitions"):
        found.of("mtp", ENV)
    assert found.unused == ["mtp on MTP-Small-v0: scored by definitions 0.9, today's are 2.0"]
    twice = known_of(write_record(*STP, name="stp"), write_record(*MTP, name="stp"))
    with pytest.raises(RecordError, match="two records of 'stp' on MTP-Small-v0, expected one"):
        twice.of("stp", ENV)
    short = known_of(
        write_record(*STP, name="stp"),
        write_record(*MTP[:4], name="mtp", env={"scenes_of_split": 8}, status_reason="4 of 8 scenes"),
    )
    with pytest.raises(RecordError, match="cannot be used: partial: 4 of 8 scenes"):
        short.of("mtp", ENV)


def test_differences_need_the_same_data() -> None:
    other = write_record(*MTP, name="mtp", env={"data_manifest": "00" * 32})
    known = known_of(write_record(*STP, name="stp"), other)
    assert known.unused == ["mtp on MTP-Small-v0: other data, scenes or hidden scenes than the ranked ones"]
    with pytest.raises(RecordError, match="the record of 'mtp' on MTP-Small-v0 cannot be used: other data, scenes"):
        Figures(known).difference("mtp", "stp", ENV)


def test_simulated_scenes_that_everybody_knows_may_be_told_of_and_hidden_ones_replace_them() -> None:
    public = [made_up("stp", 1.0, SIMULATED), made_up("mtp", 0.8, SIMULATED)]
    found = Figures(Known(public))
    assert found.error("mtp", SIMULATED).value == pytest.approx(0.8)
    assert not found.ranked("mtp", SIMULATED)
    levels = {public[1].digest: signed_level(public[1], "hidden", hidden_part(*[2.5] * 50))}
    known = Known(public, levels)
    hidden = Figures(known)
    assert hidden.error("mtp", SIMULATED).value == pytest.approx(2.5)
    assert hidden.levels(SIMULATED) == "1 run again, and on scenes that were not public"
    waits = f"stp on {SIMULATED}: not run on the hidden scenes of the last round"
    assert (known.present(["stp", "mtp"], SIMULATED), known.unused) == (["mtp"], [waits])
    with pytest.raises(RecordError, match="cannot be used: not run on the hidden scenes of the last round"):
        hidden.difference("mtp", "stp", SIMULATED)


def test_numbers_as_text() -> None:
    assert [signed(value, 2) for value in (-0.001, -0.5, 0.005)] == ["0.00", "−0.50", "0.01"]
    assert [p_text(p) for p in (0.0004, 0.0051, 0.03, 1.0)] == ["p < 0.001", "p = 0.005", "p = 0.03", "p = 1.00"]
    figure = Figure("x", 0.456, interval=(-0.1, 0.5), p=0.2)
    assert (str(figure), figure.bare, figure.ranged) == ("0.46 m", "0.46", "0.46 [−0.10, 0.50]")
    assert figure.sure == "0.46 m (−0.10 to 0.50, p = 0.20)"
    assert figure.to(1).between == "−0.1 to 0.5"
    assert Figure("x", 0.456, "share", (0.38, 0.55)).sure == "46 % (38 to 55 %)"
    assert Figure("x", 2.0).sure == "2.00 m"


LESS, MORE = Figure("a", 1.0, p=0.01), Figure("b", 2.0)
GAIN = Figure("a less b", -1.0, interval=(-1.5, -0.5), p=0.01)


@pytest.mark.parametrize(
    ("condition", "holds"),
    [
        (above(MORE, LESS), True),
        (above(LESS, MORE), False),
        (above(LESS, 1.0), False),
        (below(LESS, MORE), True),
        (below(LESS, 1.0), False),
        (within(LESS, 1.0, 1.5), True),
        (within(LESS, 1.1, 1.5), False),
        (significant(GAIN), True),
        (significant(Figure("a less b", 1.0, p=0.01)), False),
        (significant(Figure("a less b", -1.0, p=0.05)), False),
        (significant(Figure("no difference", -1.0)), False),
        (chance(Figure("a less b", -1.0, p=0.05)), True),
        (chance(GAIN), False),
        (chance(Figure("no difference", -1.0)), False),
        (all_of(above(MORE, LESS), significant(GAIN)), True),
        (all_of(above(MORE, LESS), chance(GAIN)), False),
    ],
)
def test_conditions(condition: Condition, holds: bool) -> None:
    assert bool(condition) is holds


def test_verdicts() -> None:
    worse = Figure("b less a", 1.0, p=0.01)
    assert [verdict(each) for each in (GAIN, worse, Figure("x", -1.0, p=0.2))] == [
        "holds",
        "does not hold",
        "cannot be told",
    ]


def test_a_false_claim_says_which_and_by_which_figures() -> None:
    assert claim(above(MORE, LESS), "More is more.") == "More is more."
    assert claim(above(MORE, LESS), caller=lambda: "More is more.") == "More is more."
    with pytest.raises(MtpBenchError) as caught:
        claim(all_of(above(MORE, LESS), chance(GAIN)), "It is\nchance.")
    assert str(caught.value) == (
        "claim 'It is chance.' is not what the records say: a less b: −1.00 m (−1.50 to −0.50, p = 0.01), expected p "
        "of 0.05 or more"
    )
    with pytest.raises(MtpBenchError, match="expected a condition such as above"):
        claim(True, "x")  # type: ignore[arg-type]


def test_a_table_has_a_row_per_agent_and_says_what_it_is_of(known: Known) -> None:
    text = Tables(known).table(ENV, ["truth_past", "mtp", "affinity"][:2], ["error", "rank all", "minADE lost", "ms"])
    lines = text.splitlines()
    assert lines[:2] == ["| agent | all | rank | minADE, lost | ms per frame |", "|---|--:|--:|--:|--:|"]
    assert lines[2].startswith("| true pasts | 1.50 [")
    assert lines[2].endswith("] | – | 1.50 | 1.0 |")
    assert lines[3].startswith("| MTP, H = 20 | 2.00 [")
    assert lines[3].endswith("] | 1 | 2.00 | 3.2 |")
    assert lines[4:] == [
        "| targets, objects, scenes | 80, 40, 8 |  | 16, 5, 8 |  |",
        "| effective objects, units | 40, 8.0 |  | 5, 8.0 |  |",
    ]


def test_other_columns_of_a_table(known: Known) -> None:
    tables = Tables(known)
    columns = ["plain all", "missed all", "coverage all", "less_stp all", "error ids", "minADE paper_ids"]
    lines = tables.table(ENV, ["mtp", "stp"], columns, digits=3, of=False).splitlines()
    assert lines[0] == "| agent | plain, all | missed, all | coverage | less STP, all | ids | minADE, paper IDS |"
    assert lines[2:] == [
        "| MTP, H = 20 | 2.000 | 0.600 | 100 % | −1.500 [−1.500, −1.500] | – | – |",
        "| STP | 3.500 | 1.050 | 100 % | 0.000 [0.000, 0.000] | – | – |",
    ]
    lines = tables.table(ENV, ["mtp", "stp_hedged"], ["gap all", "own_gap all", "gap lost"], of=False).splitlines()
    assert lines[0] == "| agent | gap closed (%), all | gap of its own predictor (%), all | gap closed (%), lost |"
    assert lines[2] == "| MTP, H = 20 | 75 [75, 75] | 75 [75, 75] | 75 [75, 75] |"
    assert [cell == "–" for cell in lines[3].split(" | ")] == [False, False, True, False]
    with pytest.raises(UnknownNameError, match=r"unknown measure 'minADEE': did you mean 'minADE'\?"):
        tables.table(ENV, ["mtp"], ["minADEE all"])
    with pytest.raises(RecordError, match="no record of 'affinity'"):
        tables.table(ENV, ["mtp", "affinity"])


def test_a_table_across_environments(known: Known) -> None:
    lines = Tables(known).across([("small", ENV), ("again", ENV)], ["mtp"], "lost").splitlines()
    assert lines[0] == "| agent | small | again |"
    assert lines[2].count("2.00 [") == 2
    assert lines[3] == "| effective objects, units | 5, 8.0 | 5, 8.0 |"


def test_names_of_agents_in_tables() -> None:
    assert [label(name) for name in ("stp_same_budget", "tracking_free")] == ["STP, same budget", "`tracking_free`"]


def test_texts_break_no_table() -> None:
    assert cell("a|b\nc\\|d") == "a\\|b c\\\\\\|d"
    assert markdown(["a", "b"], [["x|y", "z"]]).splitlines()[2] == "| x\\|y | z |"


PAGE = "before\n<!-- results: one -->\nold\n<!-- end of one -->\nbetween\n<!-- results: two -->\n<!-- end of two -->\n"


def test_marked_blocks_are_filled_and_nothing_else_changes() -> None:
    text = filled(PAGE, "page.md", lambda name: f"new {name}\n")
    assert text == PAGE.replace("old\n", "\nnew one\n\n").replace("two -->\n<!-- end", "two -->\n\nnew two\n\n<!-- end")
    assert filled(text, "page.md", lambda name: f"new {name}\n") == text


@pytest.mark.parametrize(
    ("page", "problem"),
    [
        ("a\n<!-- results: one -->\n", "page.md: the block 'one' has no end; write `<!-- end of one -->` below it"),
        ("<!-- end of one -->", "page.md, line 1: end of the block 'one', which was not begun"),
        (
            "<!-- results: one -->\n<!-- end of two -->",
            "page.md, line 2: end of the block 'two', expected the end of 'one'",
        ),
        (
            "<!-- results: one -->\n<!-- results: two -->",
            "page.md, line 2: the block 'two' begins inside the block 'one'",
        ),
        (f"{PAGE}{PAGE}", "page.md, line 9: the block 'one' begins a second one of that name"),
        ("<!-- results one -->", "page.md, line 1: '<!-- results one -->' is no mark of a block, expected a line"),
        ("x <!-- results: one -->", "page.md, line 1: 'x <!-- results: one -->' is no mark"),
        ("<!-- results: one -->\n<!-- End of one -->", "page.md, line 2: '<!-- End of one -->' is no mark"),
        ("nothing", "page.md: no template page.md.jinja beside it, and no block to fill"),
    ],
)
def test_a_broken_mark_is_told_with_its_line(page: str, problem: str) -> None:
    with pytest.raises(MtpBenchError) as caught:
        filled(page, "page.md", lambda _: "new")
    assert str(caught.value).startswith(problem)


@pytest.fixture
def board(tmp_path: Path) -> Path:
    """A leaderboard with two records, a page with its template, and a page with a block."""
    folder = tmp_path / "leaderboard"
    (folder / "blocks").mkdir(parents=True)
    for record in (made_up("stp", 1.0), made_up("mtp", 0.8)):
        save_record(record, folder / "records" / record.submission.name / f"{MAIN}.json")
    (folder / "RESULTS.md.jinja").write_text(
        f'{{% set env = "{MAIN}" %}}\n# Results\n\n'
        '{% call claim(significant(difference("mtp", "stp", env))) %}\n'
        'MTP has {{ error("mtp", env) }}, STP {{ error("stp", env) }} & <b>.\n'
        "{% endcall %}\n"
        '{% if has("affinity", env) %}\n{{ error("affinity", env) }}\n{% endif %}\n'
    )
    (folder / "blocks" / "first.md.jinja").write_text(f'{{{{ gain("mtp", "stp", "{MAIN}").bare }}}}\n')
    (folder / "RESULTS.md").write_text("old\n")
    (tmp_path / "README.md").write_text("a\n<!-- results: first -->\n<!-- end of first -->\nb\n")
    return folder


def run(cli: CommandLine, board: Path) -> Any:
    pages = "--fill", board / "RESULTS.md", "--fill", board.parent / "README.md"
    return cli("board", "--records", board / "records", *pages)


def test_the_command_fills_pages_in(board: Path, cli: CommandLine) -> None:
    output = run(cli, board)
    assert output.status == 0, output.err
    assert "RESULTS.md: filled in, 2 records can be told of" in " ".join(output.out.split())
    assert (board / "RESULTS.md").read_text() == "# Results\n\nMTP has 0.80 m, STP 1.00 m & <b>.\n"
    readme = "a\n<!-- results: first -->\n\n0.20\n\n<!-- end of first -->\nb\n"
    assert (board.parent / "README.md").read_text() == readme
    assert run(cli, board).status == 0
    assert (board.parent / "README.md").read_text() == readme
    assert sorted(path.name for path in board.parent.iterdir()) == ["README.md", "leaderboard"]


WRONG = {
    "claim": (
        '{{ claim(significant(difference("stp", "mtp", "MTP-WILDTRACK-k10-v0")), "STP wins.") }}',
        "line 1: claim 'STP wins.' is not what the records say: error of stp less mtp on MTP-WILDTRACK-k10-v0",
    ),
    "record": (
        '\n{{ error("affinity", "MTP-WILDTRACK-k10-v0") }}',
        "line 2: no record of 'affinity' on MTP-WILDTRACK-k10-v0",
    ),
    "agent": ('{{ error("afinity", "MTP-WILDTRACK-k10-v0") }}', "line 1: unknown agent 'afinity'"),
    "subset": ('{{ error("mtp", "MTP-WILDTRACK-k10-v0", "idss") }}', "line 1: unknown subset 'idss'"),
    "function": ('{{ eror("mtp", "MTP-WILDTRACK-k10-v0") }}', "line 1: 'eror' is undefined"),
    "argument": ('{{ error("mtp") }}', "line 1: Figures.error() missing 1 required positional argument: 'env'"),
    "attribute": ('{{ error("mtp", "MTP-WILDTRACK-k10-v0").shure }}', "line 1: "),
    "syntax": ("{% if %}", "line 1: Expected an expression"),
    "number": ('{{ within("x", 1, 2) }}', "line 1: 'str' object has no attribute"),
}


@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("place", ["RESULTS.md.jinja", "blocks/first.md.jinja"])
def test_what_is_wrong_is_one_line_and_no_page_changes(kind: str, place: str, board: Path, cli: CommandLine) -> None:
    template, problem = WRONG[kind]
    (board / place).write_text(template)
    before = {path: path.read_bytes() for path in (board / "RESULTS.md", board.parent / "README.md")}
    error = run(cli, board).error
    assert f"{Path(place).name}, {problem}" in error
    assert {path: path.read_bytes() for path in before} == before
    assert not list(board.parent.rglob("*.part*"))


def test_a_broken_mark_and_a_missing_template_leave_all_pages_as_they_are(board: Path, cli: CommandLine) -> None:
    readme = board.parent / "README.md"
    for text, problem in (
        ("<!-- results: first -->\n", "the block 'first' has no end"),
        ("<!-- results: other -->\n<!-- end of other -->\n", "no such template (other.md.jinja)"),
    ):
        readme.write_text(text)
        assert problem in run(cli, board).error
        assert readme.read_text() == text
        assert (board / "RESULTS.md").read_text() == "old\n"


def test_a_broken_record_or_a_part_of_the_records_fills_no_page(board: Path, cli: CommandLine) -> None:
    one = board / "records" / "mtp" / f"{MAIN}.json"
    for part in (("--env", MAIN), ("--with", one)):
        output = cli("board", "--records", board / "records", "--fill", board / "RESULTS.md", *part)
        assert output.status == 2
        assert "leave --env and --with out" in " ".join(output.err.replace("│", " ").split())
    one.write_text(one.read_text().replace('"hypotheses": 1', '"hypotheses": 2', 1))
    assert "no page is filled in: 1 record refused" in run(cli, board).error
    assert (board / "RESULTS.md").read_text() == "old\n"


def test_pages_are_filled_in_all_or_none(board: Path) -> None:
    found = Known([load_record(path) for path in record_paths(board / "records")])
    missing = board.parent / "nowhere" / "PAGE.md"
    with pytest.raises(MtpBenchError, match="there is no folder"):
        fill([board / "RESULTS.md", missing], found, board)
    assert (board / "RESULTS.md").read_text() == "old\n"


def test_every_function_of_templates_is_documented(repository: Path, known: Known) -> None:
    page = (repository / "leaderboard" / "MAINTAINING.md").read_text()
    for name in functions_of(known):
        assert f"`{name}(" in page, name


@pytest.fixture(scope="module")
def people_and_cars() -> Known:
    """Two environments of people, and KITTI."""
    errors = {"truth_past": 0.5, "stp": 1.0, "stp_same_budget": 0.9, "mtp": 0.8}
    return Known(
        [
            made_up(name, error, env, silence=2.0, env={"observe": "truth" if name == "truth_past" else "detections"})
            for env in (MAIN, "MTP-PETS-v0", "MTP-KITTI-v0")
            for name, error in errors.items()
        ]
    )


def test_the_template_of_results_tells_of_the_records_that_are_there(repository: Path, people_and_cars: Known) -> None:
    text = render(repository / "leaderboard" / "RESULTS.md.jinja", functions_of(people_and_cars))
    assert "| MTP, H = 20 | 0.80 [" in text
    assert text.count("MTP closes 40 % (") >= 3
    assert "Silence scores 2.00 m." in text
    assert "- Records: 4 checked by nobody but the authors." in text


def test_the_block_of_the_readme_tells_of_the_records_that_are_there(repository: Path, people_and_cars: Known) -> None:
    text = render(repository / "leaderboard" / "blocks" / "first-results.md.jinja", functions_of(people_and_cars))
    assert "| agent | WILDTRACK, k = 10 | PETS |" in text
    assert text.count("\n| ") == 6
    assert "On nuScenes" not in text
