"""A study of tiny sequences: its tables, figures, page and notebook, and the folder that it may replace."""

import csv
import html
import json
import re
import shutil
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.core.errors import MtpBenchError
from mtp_bench.running.options import RunOptions
from mtp_bench.scoring import PART_NAMES, Report, main_settings
from mtp_bench.viz import Study, study
from mtp_bench.viz.studies.figures import FIGURES, FILE_SUFFIXES, PART_COLORS, draw_figures
from mtp_bench.viz.studies.study import TABLE_SUFFIXES, study_page
from mtp_bench.viz.terminal.notes import label_of
from tests.support.browser import chromium
from tests.support.colours import APART, VISION, distance
from tests.support.command_line import CommandLine, write_submission
from tests.support.kept import kept
from tests.support.report_rows import detail, rows
from tests.test_readme import blocks


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
    result: Study = page["result"]
    return result


def errors_by_label(report: Report) -> dict[str, float]:
    """BADE of each agent in its main setting, by its label in figures."""
    shown = [block["all"] for block in main_settings(report).values()]
    return {label_of(row): row.error for row in shown if row.error is not None}


# ---- files
def test_every_table_is_written_for_programs_and_for_papers(made: Study) -> None:
    written = {path.name for path in (made.folder / "tables").iterdir()}
    assert written == {f"{name}{suffix}" for name in made.tables for suffix in TABLE_SUFFIXES}
    assert {"main", "settings", "differences", "gaps", "tracking", "rows"} <= made.tables.keys()
    for name in made.tables:
        content = json.loads((made.folder / "tables" / f"{name}.json").read_text())
        lines = list(csv.reader((made.folder / "tables" / f"{name}.csv").read_text().splitlines()))
        for line, row in zip(lines[1:], content["rows"], strict=True):
            values = [end for v in row.values() for end in (v if isinstance(v, list) else [v])]
            texts = [" ".join(str(value).split()).lstrip("-") for value in values if value not in (None, "")]
            assert [cell.lstrip("'-") for cell in line if cell] == texts, name


def test_the_rows_are_those_of_the_report(made: Study) -> None:
    written = json.loads((made.folder / "tables" / "rows.json").read_text())["rows"]
    assert written == json.loads(json.dumps([row.model_dump(mode="json") for row in made.report.rows]))


def test_the_notebook_draws_the_errors_of_the_report(made: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(made.folder)
    monkeypatch.setenv("MPLBACKEND", "agg")
    cells = json.loads((made.folder / "study.ipynb").read_text())["cells"]
    names: dict[str, Any] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    drawn = {round(error, 9) for error in names["axes"].lines[0].get_xdata()}
    assert {round(error, 9) for error in errors_by_label(made.report).values()} <= drawn
    (made.folder / "errors_redrawn.pdf").unlink()


@pytest.mark.parametrize("name", ["notes.txt", "index.html", "tables"])
def test_a_study_replaces_studies_alone(name: str, card: str, kitti: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(MtpBenchError, match=f"contains '{name}', which a study did not write"):
        study(["mtp"], card, tmp_path, RunOptions(kitti))
    assert (tmp_path / name).read_text() == "mine"


def test_the_command_on_own_agents(cli: CommandLine, tmp_path: Path, card: str, kitti: str) -> None:
    """An earlier study is replaced; an agent that fails is named on the page, and fails the command."""
    folder = tmp_path / "out"
    folder.mkdir()
    for name in ("study.ipynb", "stale.txt"):
        (folder / name).write_text("{}")
    mine = write_submission(tmp_path / "mine", "mine", body="return empty_action(self._task)")
    broken = write_submission(tmp_path / "broken", "broken", body="raise ValueError('no more')")
    given = "--env", card, "--data", kitti, "--agent", mine, "--agent", broken, "-o", folder, "--quick", "--jobs", 1
    result = cli("study", *given)
    assert result.status == 1
    assert str(folder / "index.html") in result.out.replace("\n", "")
    page = html.unescape((folder / "index.html").read_text())
    assert re.search("! broken failed .*no more", page)
    assert f"mtp-bench study --env {card}" in page
    written = json.loads((folder / "tables" / "rows.json").read_text())["rows"]
    assert "mine" in {row["agent"] for row in written}
    assert {row["seeds"] for row in written} == {1}
    assert not (folder / "stale.txt").exists()
    assert not (folder / "figures" / "hypotheses.svg").exists(), "no agent has several numbers of hypotheses"


# ---- figures
@pytest.mark.parametrize("vision", VISION)
def test_parts_are_told_apart(vision: str) -> None:
    def rgb(color: str) -> list[int]:
        return [int(color[i : i + 2], 16) for i in (1, 3, 5)]

    assert set(PART_COLORS) == set(PART_NAMES)
    for one, other in combinations(PART_COLORS.values(), 2):
        assert distance(rgb(one), rgb(other), vision) > APART, (one, other)


def test_every_figure_is_written_and_equal_reports_give_equal_files(made: Study, tmp_path: Path) -> None:
    assert [figure.name for figure in made.figures] == list(FIGURES)
    draw_figures(made.report, tmp_path)
    files = sorted(path.name for path in (made.folder / "figures").iterdir())
    assert files == sorted(f"{name}{suffix}" for name in FIGURES for suffix in FILE_SUFFIXES)
    for name in files:
        assert (tmp_path / name).read_bytes() == (made.folder / "figures" / name).read_bytes(), name


def test_without_targets_there_is_no_figure(tmp_path: Path) -> None:
    setting = ("stp", 1, 20, "equal")
    empty = rows(setting, error=None, interval=None, difference_to_stp=None, targets=0)
    assert draw_figures(Report("MTP-KITTI-v0", "2.0", empty, [], [detail(setting)]), tmp_path) == []


def test_dots_and_bars_are_the_errors_of_the_agents(made: Study) -> None:
    expected = errors_by_label(made.report)
    errors: Any = FIGURES["errors"].draw(made.report)
    parts: Any = FIGURES["parts"].draw(made.report)
    for figure in (errors, parts):
        labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
        assert labels == sorted(expected, key=lambda label: expected[label])
    dots = {labels[round(line.get_ydata()[0])]: line.get_xdata()[0] for line in errors.axes[0].lines}
    assert dots == expected
    widths = dict.fromkeys(labels, 0.0)
    for bar in parts.axes[0].patches:
        widths[labels[round(bar.get_y() + bar.get_height() / 2)]] += bar.get_width()
    assert widths == pytest.approx(expected, abs=1e-9)


def test_the_gain_of_hypotheses_stands_beside_its_controls(made: Study) -> None:
    figure: Any = FIGURES["hypotheses"].draw(made.report)
    lines = {line.get_label(): list(line.get_ydata()) for line in figure.axes[0].lines}
    shown = [row for row in made.report.rows if row.subset == "all" and row.budget == "equal"]
    differences = {row.agent: row.difference_to_stp for row in shown}
    assert lines["mtp"] == [row.difference_to_stp for row in shown if row.agent == "mtp"]
    assert len(lines["mtp"]) == 3
    for control in ("stp_same_samples", "stp_neighbours"):
        assert lines[control][0] == differences[control]


# ---- page
@pytest.fixture(scope="module")
def page(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the study alone, which needs no file beside it."""

    def copy(folder: Path) -> None:
        shutil.copy(request.getfixturevalue("made").page, folder)

    return kept("study", tmp_path_factory, copy) / "index.html"


def test_the_page_has_everything_and_loads_nothing(made: Study, page: Path) -> None:
    plain = html.unescape(page.read_text())
    for sentence in [*made.findings, *(table.title for table in made.tables.values())]:
        assert sentence in plain
    assert "blocks of at most 20 s. A rank\nneeds 6" in plain, "two sequences are too few"
    assert plain.count("data:image/svg+xml;base64,") == len(FIGURES)
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)|<script|url\(|@import""", plain)
    assert "<script>" not in study_page(replace(made, findings=["<script>"]), "<script>")


@pytest.mark.needs("browser")
def test_in_a_browser_no_request_is_made_and_nothing_is_cut_off(page: Path, tmp_path: Path) -> None:
    with chromium(tmp_path) as browser:
        grounds = set()
        for scheme in ("light", "dark"):
            browser.prefer(scheme)
            browser.forget()
            browser.open(page)
            for width in (390, 1600):
                browser.resize(width, 900)
                assert browser.script("return document.documentElement.scrollWidth") <= width
            assert browser.script("return [...document.images].every(i => i.naturalWidth > 100)")
            assert browser.console() == []
            assert {a for a in browser.requests() if not a.startswith("data:")} == {page.as_uri()}
            grounds.add(browser.script("return getComputedStyle(document.body).backgroundColor"))
        assert len(grounds) == 2
