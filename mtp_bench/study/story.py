"""The story of the page: what it asks, in which order, and which figures and tables answer."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..viz.terminal.verdict import verdict
from .figures.common import n_of
from .findings import Findings
from .table import Table
from .tables.others import people_missing


@dataclass(frozen=True)
class Chapter:
    """A part of the page; figures and tables by name, those that are not there are left out."""

    key: str
    title: str
    question: str
    figures: tuple[str, ...] = ()
    tables: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def summary(found: Findings) -> list[str]:
    """What was found, in a few sentences with intervals; the ends are stp and truth_past, and the subject's own."""
    return [*verdict(found.report, [subject.name for subject in found.plan.subjects]), *_own_ends(found)]


def _own_ends(found: Findings) -> list[str]:
    """What tracking errors cost the predictor of the subject, where that is not the predictor of the controls."""
    subject = found.subject
    if not subject.own_ends or subject.end in found.plan.controls:
        return []
    cost = found.difference(subject.end, subject.truth, "all")
    ideal, real, most = (found.row(s, "all").error for s in (subject.truth, subject.end, subject.most))
    if None in (ideal, real, most) or cost.interval is None:
        return []
    low, high = cost.interval
    count = found.row(subject.most, "all").hypotheses
    whose = "its own predictor" if subject.end == subject.single else f"the predictor of {subject.end.label}"
    return [
        (
            f"With {whose} the error over all targets is {ideal:.3f} m from true pasts and {real:.3f} m with one "
            f"hypothesis ({cost.error:+.3f} m, 95 % {low:+.3f} to {high:+.3f}); {subject.name} has {most:.3f} m with "
            f"{count}."
        )
    ]


def facts(found: Findings) -> list[tuple[str, str]]:
    """What the numbers are of."""
    condition, card = found.report.condition, found.bench.card
    told = [
        ("environment", f"{card.id}, split {condition['split']}"),
        ("agents", ", ".join(subject.name for subject in found.plan.subjects)),
        ("targets", n_of(found)),
        ("detections", condition["detections"]),
        ("truth", condition["truth"]),
        ("event weights", condition["weights"]),
        ("definitions", found.report.definitions),
    ]
    notes = {s.submission.name: s.submission.note_on(card.id) for s in found.plan.equal}
    trained = "; ".join(f"{name}: {note}" for name, note in notes.items() if note)
    return told + ([("trained on", trained)] if trained else [])


_CHAPTERS = (
    Chapter(
        "cost",
        "What tracking errors cost",
        "The same predictor is given true pasts, then the tracks of one hypothesis. How much worse does it get "
        "where identities err?",
        ("pasts",),
        ("pasts",),
    ),
    Chapter(
        "often",
        "How often, and where",
        "How often does an object lose or change its identity, and is it near the ego when it does?",
        ("frequency", "distance"),
        ("frequency", "distance"),
    ),
    Chapter(
        "gain",
        "What hypotheses win back",
        "With H hypotheses the right past is likelier to be among those that are predicted from. What is won, and "
        "how much of it would more samples from one hypothesis win too?",
        ("gain", "ranked", "gaps"),
        ("targeted", "global", "gaps"),
    ),
    Chapter(
        "shared",
        "What no hypothesis can undo",
        "Which events happen in every hypothesis?",
        ("shared", "frames"),
        ("shared", "frames"),
    ),
    Chapter(
        "choose",
        "How to choose H and k",
        "What does a frame cost, and where do more hypotheses and more samples stop to pay?",
        ("speed", "k_curve", "surface"),
        ("speed", "knee", "surface", "k_curve"),
    ),
    Chapter(
        "causes",
        "Where the remaining error comes from",
        "What part of the error is the detector's, the tracker's, the predictor's?",
        ("causes",),
        ("causes",),
    ),
    Chapter(
        "when",
        "When and for whom",
        "How long does an event hurt? Are young tracks, far objects, some classes or moving objects worse?",
        ("since", "age", "bins"),
        ("since", "age", "bins"),
    ),
    Chapter(
        "decide",
        "What decides beside tracking",
        "What do false forecasts, the stated confidence and the cut of the input change?",
        ("budgets", "calibration", "cuts"),
        ("budgets", "calibration", "cuts"),
    ),
    Chapter(
        "people",
        "Re-tracking, where people are",
        "Does re-tracking the past help, alone and together with hypotheses?",
        ("people",),
        ("people",),
    ),
)


def chapters(found: Findings, tables: dict[str, Table]) -> list[Chapter]:
    """The chapters, in order; those without a figure and a table are left out."""
    missing = people_missing(found)
    notes = {"people": (missing,)} if missing else {}
    every = [replace(chapter, notes=notes.get(chapter.key, ())) for chapter in _CHAPTERS]
    return [c for c in every if c.notes or any(name in tables for name in c.tables)]
