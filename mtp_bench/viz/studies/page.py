"""The page of a study: one HTML file that loads no other, with text, all figures and tables, and the worst moments."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core import Column, Table, cell_text
from ...running import training_note
from ...scoring import FAULT_NAMES, PARTS, RANKED_UNITS, by_fault, named_parts, place_of
from ..pages import source_of, templates_of, text_of
from ..terminal.paper import figures_of
from ..terminal.verdict import verdict
from .drawing import TEXTS, Drawing
from .figures import n_of
from .gallery import MomentPicture
from .plan import StudiedAgent
from .runs import Findings

if TYPE_CHECKING:
    from jinja2 import Environment

GALLERY = "gallery"  # chapter of the pictures
LEAST_SHARE = 0.005  # of bADE: parts below it are left out of the sentence
LEADING = ("parts", GALLERY)  # first chapters of few recordings
UNBROKEN = "\u00a0%"  # without a line break before it
_SHARE = Column(unit="share")
_HERE = Path(__file__).parent


def study_page(
    findings: Findings,
    tables: dict[str, Table],
    figures: dict[str, Drawing],
    pictures: Sequence[MomentPicture],
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
    filled = {GALLERY: bool(pictures)}
    chapters = [
        c
        for c in TEXTS["chapters"]
        if filled.get(c["key"], not {*tables}.isdisjoint(c["tables"]))
    ]
    few = f"{findings.units:.3g}" if findings.few else ""
    if few:
        chapters.sort(key=lambda chapter: chapter["key"] not in LEADING)
    content = (
        _templates()
        .get_template("page.html")
        .render(
            env=place_of(findings.report),
            subject=findings.subject.name,
            summary=summary(findings),
            facts=facts(findings),
            relations=None if few else tables.get("relations"),
            figures=figures,
            tables=tables,
            pictures=pictures,
            command=command,
            chapters=chapters,
            style=style,
            policy=policy,
            few=few,
            needed=RANKED_UNITS,
            paper=bool(figures_of(findings.bench.of_paper, "single", "equal", 1)),
        )
    )
    return f"{content.replace(' %', UNBROKEN)}\n"


@cache
def _templates() -> "Environment":
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
    """Results in a few sentences: with intervals, or, of few recordings, the causes of the error."""
    if findings.few:
        return [
            cause_sentence(findings, subject).replace(" %", UNBROKEN)
            for subject in findings.plan.subjects
        ]
    return verdict(
        findings.report, [subject.name for subject in findings.plan.subjects]
    )


def cause_sentence(findings: Findings, subject: StudiedAgent) -> str:
    """Shares of bADE of an agent with the most hypotheses by part of the stack, then by cause; largest first."""
    row = findings.row(subject.most, "all")
    causes = named_parts(
        np.array([getattr(row, f"cost_{key}") or 0.0 for key in PARTS])
        / (row.error or 1.0)
    )
    faults = {FAULT_NAMES[who]: part for who, part in by_fault(causes).items()}
    texts = [
        ", ".join(
            f"{name} {_SHARE.text(part)}"
            for name, part in shares.items()
            if abs(part) >= LEAST_SHARE
        )
        for shares in (faults, causes)
    ]
    parts = ". By cause: ".join(texts) if all(texts) else "no error"
    return f"bADE of {subject.most.label} is {row.error:.2f} m over {row.targets} targets: {parts}."


def facts(findings: Findings) -> list[tuple[str, str]]:
    """Conditions of the study, as names and texts."""
    condition, card = findings.report.condition, findings.bench.card
    own = "folder" in condition
    notes = {
        s.submission.name: training_note(s.submission, card)
        for s in findings.plan.equal
    }
    trained = "; ".join(f"{name}: {note}" for name, note in notes.items() if note)
    facts = [
        ("own scenes", place_of(findings.report) if own else ""),
        (
            "settings of" if own else "environment",
            f"{card.id}, split {condition['split']}",
        ),
        ("agents", ", ".join(subject.name for subject in findings.plan.subjects)),
        ("targets", n_of(findings)),
        ("detections", condition["detections"]),
        ("truth", condition["truth"]),
        ("event weights", condition["weights"]),
        ("budgets of false forecasts", condition["budget"]),
        ("definitions", findings.report.definitions),
        ("trained on", trained),
    ]
    return [(name, text) for name, text in facts if text]
