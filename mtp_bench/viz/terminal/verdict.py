"""The verdict of a comparison: one sentence, and all sentences."""

from collections.abc import Iterator, Sequence

from ...agent import controls
from ...core import Column
from ...scoring import (
    RANKED_SUBSETS,
    SIGNIFICANT,
    AgentScores,
    Interval,
    PairedRow,
    Report,
    Row,
    main_settings,
    paired_row,
)
from .notes import REFERENCES, label_of

STP = controls()["single"]
GT_TRACKS = controls()["ground_truth"]
SAME_SAMPLES = controls()["same_samples"]
NEIGHBOURS = controls()["neighbours"]
ASSOCIATED = controls()["associated_same_samples"]
SEVERAL = controls()["several"]
CONTROL_DRAWS = 20  # times k samples
_CONTROL_MEANINGS = {
    STP: "one hypothesis with k samples",
    SAME_SAMPLES: f"one hypothesis with {CONTROL_DRAWS} times k samples",
    NEIGHBOURS: (
        "as many, a third of them a near neighbour's (hypotheses must gain beyond both)"
    ),
}
_SUBSET_PHRASES = {
    "all": "over all targets",
    "ids": "on identity switches",
    "reacquired": "on re-acquisitions",
}
_SIGNED = Column(format="+.3f")
_METRES = Column(format=".3f")


def short_verdict(report: Report, names: Sequence[str]) -> str:
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


def verdict(report: Report, names: Sequence[str]) -> list[str]:
    """Return sentences about the submissions ``names``, without missing numbers.

    Of a submission with several settings they state the one with the most hypotheses,
    at equal k.
    """
    blocks = main_settings(report)
    sentences = list(_costs(report))
    for name in names:
        if name in blocks and name not in (STP, GT_TRACKS, ASSOCIATED):
            sentences += _against_controls(report, blocks[name]["all"])
    sentences += _unranked(report)
    return sentences


def _costs(report: Report) -> Iterator[str]:
    """Yield the costs of detection, tracking and association."""
    sentences = []
    knows_association = False
    for subset in ("all", "ids"):
        tracks = _paired(report, GT_TRACKS, STP, subset)
        association = _paired(report, ASSOCIATED, SAME_SAMPLES, subset)
        if tracks is None:
            continue
        text = f"detection and tracking together cost {_cost(tracks)}"
        if association is not None:
            knows_association = True
            text += f", of which association {_cost(association)}"
        sentences.append(f"{_SUBSET_PHRASES[subset].capitalize()} {text}.")
    if knows_association:
        sentences.append(
            "The cost of association is that to perfect association of the same "
            "detections. It is a lower bound: duplicate detections still make switches."
        )
    if sentences:
        yield " ".join(sentences)


def _paired(report: Report, agent: str, control: str, subset: str) -> PairedRow | None:
    """Return the difference of an agent's most hypotheses to a control."""
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


def _against_controls(report: Report, row: Row) -> Iterator[str]:
    """Yield differences to the controls that have one hypothesis."""
    for control, meaning in _CONTROL_MEANINGS.items():
        texts = []
        for subset in ("all", "ids"):
            pair = _paired(report, row.agent, control, subset)
            if pair is not None:
                chance = _chance(pair.interval, pair.p)
                phrase = _SUBSET_PHRASES[subset]
                texts.append(f"{phrase} {_SIGNED.text(pair.error)} m, {chance}")
        if texts:
            yield f"{label_of(row)} against {control}, {meaning}: {'; '.join(texts)}."


def _unranked(report: Report) -> Iterator[str]:
    """Yield the reasons of missing ranks, by subset."""
    texts: list[str] = []
    for subset in ("all", *RANKED_SUBSETS):
        texts += _unranked_on(report, subset)
    references = [
        row.agent for row in report.rows if row.unranked_because in REFERENCES
    ]
    if references:
        agents = ", ".join(dict.fromkeys(references))
        texts.append(f"Never ranked, as they saw the truth: {agents}")
    if texts:
        yield ". ".join(texts) + "."


def _unranked_on(report: Report, subset: str) -> Iterator[str]:
    """Yield the agents without a rank on a subset, by reason."""
    agents_by_reason: dict[str, list[str]] = {}
    has_ranks = False
    for row in report.rows:
        if row.subset != subset or row.budget != "equal":
            continue
        has_ranks |= row.place is not None
        reason = row.unranked_because
        if reason is not None and reason not in REFERENCES:
            agents_by_reason.setdefault(reason, []).append(label_of(row))
    phrase = _SUBSET_PHRASES[subset]
    if has_ranks:
        for reason, agents in agents_by_reason.items():
            yield f"Not ranked {phrase} ({reason}): {', '.join(agents)}"
    elif agents_by_reason:
        yield f"No agent is ranked {phrase} ({'; '.join(agents_by_reason)})"


def _chance(
    interval: Interval | None, p: float | None, column: Column = _SIGNED
) -> str:
    """Return interval and p as text, and if the difference could be chance."""
    if interval is None or p is None:
        return "too few recordings for an interval"
    p_text = "p < 0.001" if p < 0.001 else f"p = {p:.3f}"
    chance = ", could be chance" if p >= SIGNIFICANT else ""
    return f"95 % {column.text(interval)}, {p_text}{chance}"
