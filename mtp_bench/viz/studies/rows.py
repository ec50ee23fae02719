"""Tables of a study: rows are made by functions, texts and units are data (`texts.toml`)."""

from collections.abc import Iterator, Sequence
from types import SimpleNamespace as Row

from ...core import Column, Table
from ...running import Setting
from ...scoring import (
    FAULT_NAMES,
    FAULTS,
    NO_GAP,
    PARTS,
    Subset,
    bootstrap_interval,
    ratio,
)
from ..terminal.paper import PAPER_HYPOTHESES, PAPER_SUBSETS, figures_of, shared_events
from .drawing import TEXTS
from .plan import StudiedAgent, unique
from .relations import relation_rows
from .runs import KINDS, Findings

PAPER = "the paper's"  # group of the columns with figures of the paper
SUBSETS: tuple[Subset, ...] = (
    "all",
    "paper_ids",
    "paper_frag",
    "ids",
    "reacquired",
    "turning",
)
_SUBSET_NAMES = {"ids": "identity switch", "paper_ids": "IDS", "paper_frag": "FRAG"}
_UNIT_OF = {key: unit for unit, keys in TEXTS["units"].items() for key in keys.split()}


def make_tables(findings: Findings) -> dict[str, Table]:
    """Every table that has rows, by name."""
    tables = {}
    for name, make in ROWS.items():
        rows = list(make(findings))
        for row in rows if findings.few else ():  # nothing can be told from chance
            vars(row).update(
                {
                    key: None
                    for key in vars(row)
                    if key == "p" or key.endswith("_interval")
                }
            )
        if rows:
            title, sentence = texts_of("tables", name, findings)
            tables[name] = Table(
                name, title, sentence, rows, [column(key) for key in vars(rows[0])]
            )
    return tables


def texts_of(kind: str, name: str, findings: Findings) -> tuple[str, str]:
    """Title and sentence of a table or figure, filled in; those of a figure may be those of the table."""
    texts = TEXTS["tables"].get(name, {}) | TEXTS[kind].get(name, {})
    return texts["title"], texts["sentence"].format(
        single=findings.subject.single.label,
        intervals="" if findings.few else ", with 95 % intervals",
        paper=TEXTS["paper"]
        if figures_of(findings.bench.of_paper, "single", "equal", 1)
        else "",
        faults=", ".join(
            f"{FAULT_NAMES[who]} ({', '.join(names)})" for who, names in FAULTS.items()
        ),
    )


def column(key: str) -> Column:
    """The column of a key: "paper_" marks figures of the paper, "_interval" the 95 % interval of the column before."""
    name = key.removeprefix("paper_").removesuffix("_interval")
    part = name.removeprefix("cost_") if name.startswith("cost_") else ""
    unit = "m" if part else _UNIT_OF.get(name, "")
    return Column(
        key=key,
        heading=PARTS[part] if part else TEXTS["headings"].get(name, ""),
        unit=unit,
        format=".1%" if unit == "share" else "",
        group=PAPER if key.startswith("paper_") else "",
        optional=True,
        interval=key.endswith("_interval"),
    )


def subset_name(subset: str) -> str:
    """Name of a subset for readers."""
    return _SUBSET_NAMES.get(subset, subset)


def settings_of_rows(findings: Findings) -> Iterator[tuple[StudiedAgent, Setting]]:
    """Settings of the tables over H and k, each with the studied agent whose rows it belongs to."""
    bends = [
        setting
        for setting in findings.plan.controls
        if setting.submission.compare.role == "bends"
    ]
    for subject in findings.plan.subjects:
        equal = [
            subject.reference,
            subject.single,
            *findings.plan.rivals,
            *bends,
            *subject.equal.values(),
        ]
        for setting in unique([subject.truth, *equal, *subject.free.values()]):
            yield subject, setting


def _subsets(findings: Findings, but: str = "-") -> list[Subset]:
    """Subsets of the tables; "turning" where a target turns, and none that begins with ``but``."""
    there = {row.subset for row in findings.report.rows}
    return [
        subset for subset in SUBSETS if subset in there and not subset.startswith(but)
    ]


def error_rows(findings: Findings) -> Iterator[Row]:
    """Tables I to III of the paper: errors of each setting on all targets, and on those with events."""
    for subset in _subsets(findings):
        yield from (
            _error_row(findings, *each, subset) for each in settings_of_rows(findings)
        )


def _error_row(
    findings: Findings, subject: StudiedAgent, setting: Setting, subset: Subset
) -> Row:
    row, table, difference = (
        findings.row(setting, subset),
        findings.table(setting),
        None,
    )
    if setting.budget == "equal" and setting is not subject.single:
        difference = findings.difference(setting, subject.single, subset)
    weight, papers = (
        table.weight[subset],
        _paper_figures(findings, subject, setting, subset),
    )
    covered, no_gap = (
        table.unit_weight(weight * table.covered),
        row.association_gap_blank_because,
    )
    return Row(
        targets_of=subset_name(subset),
        agent=setting.label,
        H=row.hypotheses,
        k=row.samples,
        sampling="–"
        if row.hypotheses == 1
        else "k of all"
        if setting.budget == "equal"
        else "none",
        minADE=row.minADE,
        minADE_interval=bootstrap_interval(
            table.per_unit(table.min_ade, weight), covered
        ),
        minFDE=row.minFDE,
        error=row.error,
        error_interval=row.interval,
        to_single=difference and difference.error,
        to_single_interval=difference and difference.interval,
        p=difference and difference.p,
        association_gap=row.association_gap_closed,
        association_gap_interval=row.association_gap_interval,
        no_gap_because="too few recordings"
        if findings.few and no_gap == NO_GAP
        else no_gap,
        coverage=row.coverage,
        targets=row.targets,
        objects=row.objects,
        ms_per_frame=row.ms_per_frame,
        paper_minADE=papers[0],
        paper_minFDE=papers[1],
    )


def _paper_figures(
    findings: Findings, subject: StudiedAgent, setting: Setting, subset: Subset
) -> Sequence[float | None]:
    """The paper's minADE and minFDE for the role of a setting; None where it has none."""
    role = (
        "ground_truth"
        if setting == subject.truth
        else "single"
        if setting == subject.single
        else "several"
    )
    if setting in findings.plan.controls and role == "several":
        return None, None
    figures = figures_of(
        findings.bench.of_paper, role, setting.budget, setting.hypotheses or 1
    )
    return figures.get(PAPER_SUBSETS.get(subset, ""), (None, None))


def event_rows(findings: Findings) -> Iterator[Row]:
    """Events with one hypothesis, and those in every one of several hypotheses."""
    papers = shared_events(findings.bench.of_paper)
    for subject in findings.plan.subjects:
        several = {
            count: setting for count, setting in subject.equal.items() if count > 1
        }
        for kind in KINDS:
            paper = papers.get(kind, {})
            single = sum(
                scene.own[kind] for scene in findings.of(subject.single).events[0]
            )
            for count, setting in ({1: subject.single} | several).items():
                near = findings.of(setting).events[0]
                events = sum(
                    (scene.own if count == 1 else scene.shared)[kind] for scene in near
                )
                yield Row(
                    kind=kind,
                    agent=subject.name,
                    H=count,
                    events=events,
                    per_trajectory=events
                    / max(1, sum(scene.objects for scene in near)),
                    per_frame=events / max(1, sum(scene.frames for scene in near)),
                    left=events / single if single else None,
                    paper_events=paper.get(
                        {1: "one", PAPER_HYPOTHESES: "all"}.get(count, "")
                    ),
                )


def sample_rows(findings: Findings) -> Iterator[Row]:
    """Expected minADE over H and k, of settings with all samples."""
    for subject in findings.plan.subjects if findings.subject.free else ():
        for count, setting in {1: subject.single, **subject.free}.items():
            table = findings.table(setting)
            ids = table.weight["ids"]
            for k, curve in zip(
                findings.of(setting).scores[0][0].ks, table.curve.T, strict=True
            ):
                yield Row(
                    agent=subject.name,
                    H=count,
                    k=k,
                    minADE=ratio(curve.sum(), table.covered.sum()),
                    minADE_ids=ratio(
                        float((curve * ids).sum()), float((table.covered * ids).sum())
                    ),
                )


def part_rows(findings: Findings) -> Iterator[Row]:
    """The parts of bADE, which add up to it."""
    rows: list[Row] = []
    for subset in _subsets(findings, but="paper"):
        for _, setting in settings_of_rows(findings):
            row = findings.row(setting, subset)
            if setting.budget != "equal" or row.error is None:
                continue
            own = Row(
                targets_of=subset_name(subset),
                agent=row.agent,
                H=row.hypotheses,
                error=row.error,
                **{f"cost_{part}": getattr(row, f"cost_{part}") for part in PARTS},
                targets=row.targets,
                objects=row.objects,
            )
            rows += (
                [] if own in rows else [own]
            )  # a control stands beside every subject
    yield from rows


ROWS = {
    "errors": error_rows,
    "events": event_rows,
    "samples": sample_rows,
    "parts": part_rows,
    "relations": relation_rows,
}
