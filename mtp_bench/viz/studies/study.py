"""One comparison, written as tables, figures, a page and a notebook."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

import numpy as np

from ...cards import Card
from ...core import (
    Column,
    Table,
    columns_of,
    make_folder,
    tables_text,
    to_html,
    whole_folder,
    write_text,
)
from ...doubts import Doubt
from ...running import (
    DEFAULTS,
    RunKeywords,
    RunOptions,
    compare,
    doubt_lines,
    resolve_options,
    skipped_line,
)
from ...scoring import (
    PART_NAMES,
    PARTS,
    RANKED_UNITS,
    AgentSetting,
    Report,
    error_parts,
    main_table,
    place_of,
)
from ..doubted import blamed_parts, doubt_numbers
from ..pages import page_of, require_own_folder, text_of
from ..terminal.notes import warnings
from ..terminal.tables import PART_TABLES, data_table, full_tables
from ..terminal.verdict import cost_lines, verdict
from .figures import DrawnFigure, draw_figures

TABLE_SUFFIXES = (".csv", ".json", ".tex")
_PAGE = "index.html"
_NOTEBOOK = "study.ipynb"
_TEMPLATES = Path(__file__).parent
_SETTING_COLUMNS = columns_of(AgentSetting)


@dataclass(frozen=True, eq=False)
class Study:
    """Results of a study, and the folder of its files."""

    folder: Path
    report: Report
    tables: dict[str, Table]  # by name
    figures: list[DrawnFigure]
    findings: list[str]  # sentences: doubts, costs, and the verdict
    warnings: list[str]

    @property
    def page(self) -> Path:
        """The HTML page."""
        return self.folder / _PAGE


def study(
    agents: Sequence[str],
    env_id: str | Card,
    folder: str | Path,
    options: RunOptions = DEFAULTS,
    command: str = "",
    doubts: Sequence[Doubt] = (),
    **keywords: Unpack[RunKeywords],
) -> Study:
    """Compare agents, and write tables, figures and a page.

    Args:
        agents: Folders of submissions, or names of baselines.
        env_id: Id of the env, path of its card, or a card.
        folder: New or empty, or the folder of an earlier study, which is replaced.
        options: Data, scenes, seeds, workers and progress, as of `compare`.
        command: Command that makes the study again, shown on the page.
        doubts: Of `doctor`, about these scenes: findings, and blamed for errors.
        keywords: As of `compare`, in place of options.

    Raises MtpBenchError for wrong arguments and broken data.
    """
    folder = Path(folder).absolute()
    require_study_folder(folder)
    env_id, options = resolve_options(env_id, options, keywords)
    options.card(env_id).require_same_scenes("of which there is no study")
    comparison = compare(agents, env_id, options)
    report = comparison.report
    best = filter(None, [verdict(report, comparison.names(agents))])
    warning_lines = list(warnings(report))
    skipped = skipped_line(comparison.skipped)
    if skipped:
        warning_lines.append(skipped)
    tables = study_tables(report)
    if doubts:
        tables["parts"] = _blamed_table(report, options.card(env_id), doubts)
        for name in PART_TABLES:  # they blame agents alone
            del tables[name]
    with whole_folder(folder) as part:
        make_folder(part / "figures")
        result = Study(
            folder=folder,
            report=report,
            tables=tables,
            figures=draw_figures(report, part / "figures", has_parts=not doubts),
            findings=[*doubt_lines(doubts), *cost_lines(report), *best],
            warnings=warning_lines,
        )
        _write_tables(part / "tables", result.tables)
        write_text(part / _PAGE, study_page(result, command))
        write_text(part / _NOTEBOOK, text_of(_TEMPLATES, _NOTEBOOK))
    return result


def require_study_folder(folder: Path) -> None:
    """Raise MtpBenchError unless ``folder`` is new, empty or an earlier study."""
    require_own_folder(folder, _NOTEBOOK, "a study")


def _write_tables(folder: Path, tables: Mapping[str, Table]) -> None:
    make_folder(folder)
    for name, table in tables.items():
        for suffix in TABLE_SUFFIXES:
            text = tables_text(suffix, [table], table)
            write_text(folder / f"{name}{suffix}", text)


def study_page(result: Study, command: str) -> str:
    """Return the HTML of a study.

    It has no script and loads no other file. Equal results give equal bytes.
    """
    return page_of(
        _TEMPLATES,
        "page.html",
        place=place_of(result.report),
        facts=_facts(result.report),
        units=result.report.rows[0].effective_units,
        needed_units=RANKED_UNITS,
        study=result,
        to_html=to_html,
        command=command,
    )


def _facts(report: Report) -> dict[str, str]:
    """Return the conditions of a report by name."""
    condition = report.condition
    row = report.rows[0]
    return {
        "environment": f"{report.env}, split {condition['split']}",
        "targets": f"{row.targets} of {row.objects} objects in {row.scenes} scenes",
        "seeds": str(row.seeds),
        "detections": condition["detections"],
        "truth": condition["truth"],
        "event weights": condition["weights"],
        "budgets of false forecasts": condition["budget"],
        "trained on": condition.get("trained", ""),
        "definitions": report.definitions,
    }


def study_tables(report: Report) -> dict[str, Table]:
    """Return the tables by name. The last has every number."""
    tables = (
        main_table(report),
        *full_tables(report),
        data_table(report),
    )
    return {table.name: table for table in tables}


def _blamed_table(report: Report, card: Card, doubts: Sequence[Doubt]) -> Table:
    """Return the parts of bADE, m, with the blame of doubted targets on the data."""
    scene_numbers = []
    for score in report.tables[0].setting.seeds[0]:  # all have the same targets
        of_scene = [doubt for doubt in doubts if doubt.scene == score.scene]
        scene_numbers.append(
            doubt_numbers(of_scene, card, score.frame, score.object_id)
        )
    is_doubted = np.concatenate(scene_numbers) >= 0
    rows = []
    for table in report.tables:
        known = error_parts(table, "all")
        unknown = np.zeros(len(is_doubted))
        part = np.column_stack([known.get(name, unknown) for name in PART_NAMES])
        mean_m = blamed_parts(part, is_doubted).sum(axis=0) / max(1, len(part))
        rows.append(table.setting.key | dict(zip(PARTS, mean_m.tolist(), strict=True)))
    columns = [Column(key=name, unit="m") for name in PARTS]
    title = "Parts of bADE (all targets, m), with the share of doubtful data"
    return Table("parts", title, "", rows, [*_SETTING_COLUMNS, *columns])
