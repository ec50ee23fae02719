"""The page of a study: one HTML file that loads no other, with text, all figures and tables, and the worst events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..running.settings import training_note
from ..scoring.main_table import place_of
from ..tables import Column, Table
from ..tables.table import cell_text
from ..viz.pages import source_of, templates_of, text_of
from ..viz.terminal.verdict import verdict
from .drawing import Drawing
from .figures import n_of
from .findings import Findings
from .gallery import EventPicture
from .rows import TEXTS

if TYPE_CHECKING:
    from jinja2 import Environment

_HERE = Path(__file__).parent


def study_page(
    findings: Findings,
    tables: dict[str, Table],
    figures: dict[str, Drawing],
    pictures: Sequence[EventPicture],
    command: str,
) -> str:
    """HTML of a study; ``command``: that makes it again.

    Equal findings give equal bytes: the page holds no date and no random id.
    """
    style = text_of(_HERE, "page.css")
    policy = (
        f"default-src 'none'; style-src-elem {source_of(style)}; style-src-attr 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
    content = _templates().get_template("page.html").render(
        env=place_of(findings.report), subject=findings.subject.name, summary=summary(findings), facts=facts(findings),
        relations=tables.get("relations"), figures=figures, tables=tables, pictures=pictures, command=command,
        chapters=TEXTS["chapters"], style=style, policy=policy,
    )  # fmt: skip
    return f"{content}\n"


@cache
def _templates() -> Environment:
    environment = templates_of(_HERE)
    environment.globals.update(cell_text=cell_text, relation_value=relation_value)
    return environment


def relation_value(row: Any) -> str:
    """Value of a relation with its interval and unit."""
    share = row.unit == "share"
    value = Column(key="value", format=".1%" if share else "")
    text = cell_text(value, replace(value, key="value_interval"), row)
    return text if share or row.value is None else f"{text} {row.unit}"


def summary(findings: Findings) -> list[str]:
    """Results in a few sentences with intervals."""
    return verdict(findings.report, [subject.name for subject in findings.plan.subjects])


def facts(findings: Findings) -> list[tuple[str, str]]:
    """Conditions of the study, as names and texts."""
    condition, card = findings.report.condition, findings.bench.card
    notes = {s.submission.name: training_note(s.submission, card) for s in findings.plan.equal}
    trained = "; ".join(f"{name}: {note}" for name, note in notes.items() if note)
    facts = [
        ("environment", f"{card.id}, split {condition['split']}"),
        ("own scenes", place_of(findings.report) if "folder" in condition else ""),
        ("agents", ", ".join(subject.name for subject in findings.plan.subjects)),
        ("targets", n_of(findings)),
        ("detections", condition["detections"]),
        ("truth", condition["truth"]),
        ("event weights", condition["weights"]),
        ("definitions", findings.report.definitions),
        ("trained on", trained),
    ]
    return [(name, text) for name, text in facts if text]
