"""Tables of a study: their rows are made by functions, their texts and units are data (`texts.toml`)."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from ..tables import Column, Table
from . import error_rows, part_rows
from .findings import Findings
from .relations import relation_rows

PAPER = "the paper's"  # group of the columns with figures of the paper
TEXTS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("texts.toml").read_text(encoding="utf-8"))
ROWS = {
    "pasts": error_rows.past_rows,
    "frequency": part_rows.frequency_rows,
    "distance": part_rows.distance_rows,
    "targeted": error_rows.targeted_rows,
    "global": error_rows.global_rows,
    "shared": part_rows.shared_rows,
    "frames": part_rows.frame_rows,
    "speed": error_rows.speed_rows,
    "surface": error_rows.surface_rows,
    "k_curve": error_rows.k_rows,
    "knee": error_rows.knee_rows,
    "causes": part_rows.cause_rows,
    "gaps": error_rows.gap_rows,
    "since": part_rows.since_rows,
    "age": part_rows.age_rows,
    "bins": part_rows.bin_rows,
    "budgets": error_rows.budget_rows,
    "calibration": part_rows.calibration_rows,
    "cuts": error_rows.cut_rows,
    "people": error_rows.people_rows,
    "relations": relation_rows,
}
_UNIT_OF = {key: unit for unit, keys in TEXTS["units"].items() for key in keys.split()}


def make_tables(findings: Findings) -> dict[str, Table]:
    """Every table that has rows, by name."""
    tables = {}
    for name, make in ROWS.items():
        rows = list(make(findings))
        if rows:
            title, sentence = texts_of("tables", name, findings)
            tables[name] = Table(name, title, sentence, rows, [column(key) for key in vars(rows[0])])
    return tables


def texts_of(kind: str, name: str, findings: Findings, **words: str) -> tuple[str, str]:
    """Title and sentence of a table or figure, filled in; those of a figure may be those of the table."""
    texts = TEXTS["tables"].get(name, {}) | TEXTS[kind].get(name, {})
    subject = findings.subject
    words |= {"single": subject.single.label, "subject": subject.name, "most": str(subject.most.hypotheses or 1)}
    known = findings.table(subject.single).budgets.false_known
    words["allowed"] = "false forecasts per target" if known else "forecasts per live frame"
    return texts["title"], texts["sentence"].format(**words)


def column(key: str) -> Column:
    """The column of a key: "paper_" marks figures of the paper, "_interval" the 95 % interval of the column before."""
    name = key.removeprefix("paper_").removesuffix("_interval")
    unit = _UNIT_OF.get(name, "")
    return Column(
        key=key,
        heading="GT tracks" if name == "gt_tracks" else name.replace("_", " "),
        unit=unit,
        format=".1%" if unit == "share" else "",
        group=PAPER if key.startswith("paper_") else "",
        optional=True,
        interval=key.endswith("_interval"),
    )
