"""The verdict of a comparison in a sentence, and what errors of the stages cost."""

from collections.abc import Iterator, Sequence

from ...agent import controls
from ...core import Column
from ...scoring import (
    RANKED_OBJECTS,
    SIGNIFICANT,
    AgentScores,
    Interval,
    PairedRow,
    Report,
    Row,
    main_settings,
    paired_row,
)
from .notes import REFERENCES

STP = controls()["single"]
GT_TRACKS = controls()["ground_truth"]
SAME_SAMPLES = controls()["same_samples"]
NEIGHBOURS = controls()["neighbours"]
ASSOCIATED = controls()["associated_same_samples"]
SEVERAL = controls()["several"]
_SUBSET_PHRASES = {"all": "Over all targets", "ids": "On identity switches"}
_SIGNED = Column(format="+.3f")
_METRES = Column(format=".3f")


def verdict(report: Report, names: Sequence[str]) -> str:
    """Return one sentence about the submissions ``names``.

    On baselines it states the gains of perfect association and of several hypotheses
    over the controls on identity switches. Else it states the best agent over all
    targets, and its difference to the next one, or to the best of ``names``. It is
    empty if no such numbers exist.
    """
    submitted = [name for name in names if name not in controls().values()]
    association = _paired(report, ASSOCIATED, SAME_SAMPLES, "ids")
    gains = []
    for control in (SAME_SAMPLES, NEIGHBOURS):
        pair = _paired(report, SEVERAL, control, "ids")
        if pair is not None:
            gains.append(_gain(pair))
    if submitted or SEVERAL not in names or association is None or not gains:
        return _best(report, submitted or names)
    return (
        f"On identity switches perfect association {_gain(association)}; "
        f"{SEVERAL} {' and '.join(gains)}."
    )


def _gain(pair: PairedRow) -> str:
    """Return the gain or loss of an agent against a control."""
    error_m = pair.error or 0.0
    verb = "loses"
    interval = pair.interval
    if error_m < 0:
        verb = "wins"
        interval = _negated(interval)
    chance = _chance(interval, pair.p, _METRES)
    return f"{verb} {_METRES.text(abs(error_m))} m against {pair.other} ({chance})"


def _best(report: Report, names: Sequence[str]) -> str:
    """Return the best agent over all targets, and its lead, in a sentence."""
    rows = _rankable_rows(report)
    if not rows:
        return ""
    best, *rivals = rows
    if best not in names:
        rivals = [name for name in rivals if name in names]
    if not rivals:
        return ""
    tables = {_setting_key(table.setting): table for table in report.tables}
    best_table = tables.get(_setting_key(rows[best]))
    rival_table = tables.get(_setting_key(rows[rivals[0]]))
    if best_table is None or rival_table is None:
        return ""
    pair = paired_row(rival_table, best_table, "all")
    return (
        f"Over all targets {best} has the lowest bADE, "
        f"{_METRES.text(rows[best].error)} m; {rivals[0]} has "
        f"{_METRES.text(pair.error)} m more "
        f"({_chance(pair.interval, pair.p, _METRES)})."
    )


def _rankable_rows(report: Report) -> dict[str, Row]:
    """Return the rows of agents that may be ranked, best first."""
    rows: dict[str, Row] = {}
    for name, block in main_settings(report).items():
        row = block["all"]
        if row.error is not None and row.unranked_because not in REFERENCES:
            rows[name] = row
    return dict(sorted(rows.items(), key=lambda item: item[1].error or 0.0))


def _setting_key(setting: Row | AgentScores) -> tuple[str, int, int]:
    return setting.agent, setting.hypotheses, setting.samples


def cost_lines(report: Report) -> Iterator[str]:
    """Yield the costs of detection, tracking and association."""
    sentences = []
    knows_association = False
    for subset, phrase in _SUBSET_PHRASES.items():
        tracks = _paired(report, GT_TRACKS, STP, subset)
        association = _paired(report, ASSOCIATED, SAME_SAMPLES, subset)
        if tracks is None:
            continue
        text = f"detection and tracking together cost {_cost(tracks)}"
        if association is not None:
            knows_association = True
            text += f", of which association {_cost(association)}"
        sentences.append(f"{phrase} {text}.")
    if knows_association:
        sentences.append(
            "The cost of association is that to perfect association of the same "
            "detections. It is a lower bound: duplicate detections still make switches."
        )
    if sentences:
        yield " ".join(sentences)


def _paired(report: Report, agent: str, control: str, subset: str) -> PairedRow | None:
    """Return the difference of an agent's most hypotheses to a control.

    None for fewer switches and the like than ranks need.
    """
    objects = [
        row.effective_objects or 0 for row in report.rows if row.subset == subset
    ]
    # alike for all agents with targets
    if subset != "all" and max(objects, default=0) < RANKED_OBJECTS:
        return None
    key = (agent, "equal", control, subset)
    pairs = [
        row
        for row in report.paired
        if (row.agent, row.budget, row.other, row.subset) == key
        and row.error is not None
    ]
    return max(pairs, key=lambda row: row.hypotheses, default=None)


def _cost(pair: PairedRow) -> str:
    """Return the error of the control less that of the agent, as text."""
    cost_m = -(pair.error or 0.0)
    return f"{_SIGNED.text(cost_m)} m ({_chance(_negated(pair.interval), pair.p)})"


def _negated(interval: Interval | None) -> Interval | None:
    """Return the interval of a number whose sign is reversed."""
    return None if interval is None else (-interval[1], -interval[0])


def _chance(
    interval: Interval | None, p: float | None, column: Column = _SIGNED
) -> str:
    """Return interval and p as text, and if the difference could be chance."""
    if interval is None or p is None:
        return "too few recordings for an interval"
    p_text = "p < 0.001" if p < 0.001 else f"p = {p:.3f}"
    chance = ", could be chance" if p >= SIGNIFICANT else ""
    return f"95 % {column.text(interval)}, {p_text}{chance}"
