"""The verdict of a comparison: one sentence, and all sentences."""

from collections.abc import Iterator, Mapping, Sequence

from ...agent import Role, controls
from ...core import Column
from ...scoring import (
    RANKED_SUBSETS,
    SIGNIFICANT,
    Interval,
    PairedRow,
    Report,
    Row,
    Subset,
    main_settings,
    paired_row,
    shipped_env,
)
from .paper import paper_gap
from .tables import REFERENCES, label_of

_ROLES: tuple[Role, ...] = (
    "single",
    "ground_truth",
    "same_samples",
    "neighbours",
    "associated_same_samples",
    "several",
)
STP, TRUTH, CONTROL, NEIGHBOURS, ASSOCIATED, SEVERAL = (
    controls()[role] for role in _ROLES
)
CONTROL_DRAWS = 20  # times k samples
_CONTROLS = {
    STP: "one hypothesis with k samples",
    CONTROL: f"one hypothesis with {CONTROL_DRAWS} times k samples",
    NEIGHBOURS: "as many, a third of them a near neighbour's (hypotheses must gain beyond both)",
}
_SAME = "gap_closed_same_predictor"
_GAPS = {  # field of a share -> the beginning of the other fields of its gap, and its name
    "gap_closed": ("gap", f"gap between {STP} and ground-truth tracks"),
    _SAME: ("gap_same_predictor", "same gap with its own predictor and presence"),
    "association_gap_closed": ("association_gap", "association gap"),
}
_SIGNED, _METRES, _SHARE = (
    Column(format="+.3f"),
    Column(format=".3f"),
    Column(format=".1%"),
)
WHERE = {
    "all": "over all targets",
    "ids": "on identity switches",
    "reacquired": "on re-acquisitions",
}


def short_verdict(report: Report, names: Sequence[str]) -> str:
    """One sentence about the submissions ``names``; empty where nothing can be compared.

    Of baselines: what perfect association and several hypotheses win beyond the controls on identity switches.
    Of others: the best agent over all targets, and its difference to the next one, or to the best of ``names``.
    """
    own = [name for name in names if name not in controls().values()]
    cost = _paired(report, ASSOCIATED, CONTROL, "ids", None)
    pairs = [
        _paired(report, SEVERAL, control, "ids", None)
        for control in (CONTROL, NEIGHBOURS)
    ]
    gains = [_gain(pair) for pair in pairs if pair is not None]
    if own or SEVERAL not in names or cost is None or not gains:
        return _best(report, own or names)
    return f"On identity switches perfect association {_gain(cost)}; {SEVERAL} {' and '.join(gains)}."


def _gain(pair: PairedRow) -> str:
    """The gain or loss of an agent against a control."""
    error = pair.error or 0.0
    verb, interval = (
        ("wins", _turned(pair.interval)) if error < 0 else ("loses", pair.interval)
    )
    return f"{verb} {_METRES.text(abs(error))} m against {pair.other} ({_chance(interval, pair.p, _METRES)})"


def _best(report: Report, names: Sequence[str]) -> str:
    """The best agent over all targets that may be ranked, and how sure that is."""
    settings = {name: rows["all"] for name, rows in main_settings(report).items()}
    able = [
        name
        for name, row in settings.items()
        if row.error is not None and row.unranked_because not in REFERENCES
    ]
    first, *others = sorted(able, key=lambda name: settings[name].error or 0.0) or [""]
    other = next((name for name in others if first in names or name in names), None)
    if other is None:
        return ""
    tables = {
        (t.setting.agent, t.setting.hypotheses, t.setting.samples): t
        for t in report.tables
    }
    best, next_best = (
        tables.get((r.agent, r.hypotheses, r.samples))
        for r in (settings[first], settings[other])
    )
    if best is None or next_best is None:
        return ""
    pair = paired_row(next_best, best, "all")
    return (
        f"Over all targets {first} has the lowest bADE, {_METRES.text(settings[first].error)} m; {other} has "
        f"{_METRES.text(pair.error)} m more ({_chance(pair.interval, pair.p, _METRES)})."
    )


def verdict(report: Report, names: Sequence[str]) -> list[str]:
    """Sentences about the submissions ``names``; those whose numbers are missing are left out.

    Of a submission with several settings they state the one with the most hypotheses, at equal k.
    """
    blocks = main_settings(report)
    sentences = [_costs(report)]
    for rows in (
        blocks[name]
        for name in names
        if name in blocks and name not in (STP, TRUTH, ASSOCIATED)
    ):
        sentences += [*_against_controls(report, rows["all"]), _gap(report, rows)]
    sentences.append(_unranked(report))
    return [sentence for sentence in sentences if sentence]


def _costs(report: Report) -> str | None:
    """Costs of detection, tracking and association; only that of association is one of tracking errors alone."""
    sentences, known = [], False
    for subset in ("all", "ids"):
        both, own = (
            _paired(report, TRUTH, STP, subset),
            _paired(report, ASSOCIATED, CONTROL, subset),
        )
        if both is not None:
            association = f", of which association {_cost(own)}" if own else ""
            where = WHERE[subset].capitalize()
            sentences.append(
                f"{where} detection and tracking together cost {_cost(both)}{association}"
            )
            known |= own is not None
    if known:
        sentences.append(
            "The cost of association is that to perfect association of the same detections. It is a lower bound: "
            "duplicate detections still make switches"
        )
    return ". ".join(sentences) + "." if sentences else None


def _paired(
    report: Report, agent: str, other: str, subset: str, hypotheses: int | None = 1
) -> PairedRow | None:
    """The difference of an agent to a control on a subset; None without both. ``hypotheses``: None takes the most."""
    key = (agent, "equal", other, subset)
    rows = [
        r
        for r in report.paired
        if (r.agent, r.budget, r.other, r.subset) == key and r.error is not None
    ]
    rows = [row for row in rows if hypotheses in (None, row.hypotheses)]
    return max(rows, key=lambda row: row.hypotheses, default=None)


def _cost(pair: PairedRow) -> str:
    """The error of the control less that of the agent."""
    return f"{_SIGNED.text(-(pair.error or 0.0))} m ({_chance(_turned(pair.interval), pair.p)})"


def _turned(interval: Interval | None) -> Interval | None:
    """The interval of the number with its sign reversed."""
    return None if interval is None else (-interval[1], -interval[0])


def _against_controls(report: Report, row: Row) -> Iterator[str]:
    """Differences to the controls that have one hypothesis."""
    for control, description in _CONTROLS.items():
        pairs = [
            _paired(report, row.agent, control, subset, row.hypotheses)
            for subset in ("all", "ids")
        ]
        parts = [f"{WHERE[pair.subset]} {_difference(pair)}" for pair in pairs if pair]
        if parts:
            yield f"{label_of(row)} against {control}, {description}: {'; '.join(parts)}."


def _gap(report: Report, of_subsets: Mapping[Subset, Row]) -> str | None:
    """Shares of the gaps that an agent closes, with that in the paper, and reasons of those that are blank."""
    rows = row, _ = of_subsets["all"], of_subsets["ids"]
    parts: dict[str, list[str]] = {"closes": [], "widens": [], "closes no share of": []}
    for key, (gap, name) in _GAPS.items():
        shares = _shares(rows, key, f"{gap}_interval")
        if key == _SAME and shares == _shares(rows, "gap_closed", "gap_interval"):
            continue
        for verb, texts in shares.items():
            parts[verb].append(f"the {name} by {' and '.join(texts)}")
        if not shares and (why := getattr(row, f"{gap}_blank_because", None)):
            parts["closes no share of"].append(f"the {name}: {why}")
    paper = paper_gap(shipped_env(report), row)
    if paper is not None and parts["closes"]:
        parts["closes"][-1] += (
            f" (in the paper, by minADE on IDS: {_SHARE.text(paper)})"
        )
    sentences = [
        f"{label_of(row)} {verb} {'; '.join(texts)}."
        for verb, texts in parts.items()
        if texts
    ]
    return " ".join(sentences) or None


def _shares(rows: Sequence[Row], share: str, interval: str) -> dict[str, list[str]]:
    """Shares on the subsets of the rows, with intervals, of gaps that are closed and of those that are widened."""
    shares: dict[str, list[str]] = {}
    for row in rows:
        value, ends = getattr(row, share), getattr(row, interval)
        if value is not None:
            ends, verb = (ends, "closes") if value >= 0 else (_turned(ends), "widens")
            known = "" if ends is None else f" (95 % {_SHARE.text(ends)})"
            shares.setdefault(verb, []).append(
                f"{_SHARE.text(abs(value))}{known} {WHERE[row.subset]}"
            )
    return shares


def _unranked(report: Report) -> str | None:
    """Reasons of missing ranks, by subset; ranks stand in the table."""
    parts = []
    for subset in ("all", *RANKED_SUBSETS):
        rows = [
            row for row in report.rows if row.subset == subset and row.budget == "equal"
        ]
        reasons: dict[str, list[str]] = {}
        for row in rows:
            if row.unranked_because not in (None, *REFERENCES):
                reasons.setdefault(str(row.unranked_because), []).append(label_of(row))
        if any(row.place is not None for row in rows):
            parts += [
                f"Not ranked {WHERE[subset]} ({why}): {', '.join(labels)}"
                for why, labels in reasons.items()
            ]
        elif reasons:
            parts.append(f"No agent is ranked {WHERE[subset]} ({'; '.join(reasons)})")
    ideal = dict.fromkeys(
        row.agent for row in report.rows if row.unranked_because in REFERENCES
    )
    parts += (
        [f"Never ranked, as they saw the truth: {', '.join(ideal)}"] if ideal else []
    )
    return ". ".join(parts) + "." if parts else None


def _difference(pair: PairedRow) -> str:
    return f"{_SIGNED.text(pair.error)} m, {_chance(pair.interval, pair.p)}"


def _chance(
    interval: Interval | None, p: float | None, column: Column = _SIGNED
) -> str:
    """An interval and p, in words where it could be chance."""
    if interval is None or p is None:
        return "too few recordings for an interval"
    chance = ", could be chance" if p >= SIGNIFICANT else ""
    return f"95 % {column.text(interval)}, {'p < 0.001' if p < 0.001 else f'p = {p:.3f}'}{chance}"
