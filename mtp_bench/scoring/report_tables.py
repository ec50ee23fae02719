"""The main table of a report: a row per agent, the best first."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated

from ..cards import load_card
from ..core import Column, Table, card_ids, columns_of, counted
from .definitions import Subset
from .details import misstated
from .rank import span_text
from .report import Report
from .rows import Budget, Row

FAILED = "failed"  # in place of a number
MEANING = (
    "bADE (budgeted ADE): mean over targets and budgets of min(minADE, c), or c without a forecast. #: ranks in this "
    "run; –: saw the truth or too few objects."
)
NAMES: dict[Subset, str] = {
    "all": "all targets",
    "ids": "identity switch",
    "lost": "lost",
    "reacquired": "reacquired",
    "frag": "lost or reacquired",
    "paper_ids": "IDS as in the paper",
    "paper_frag": "FRAG as in the paper",
    "turning": "turning",
}
_ALL, _IDS = NAMES["all"], NAMES["ids"]


@dataclass(frozen=True)
class MainRow:
    """An agent in its main setting."""

    agent: Annotated[str, Column(help="Name as in commands.")]
    hypotheses: Annotated[
        int | None, Column("H", help="Hypotheses of the tracker.")
    ] = None
    error: Annotated[
        float | str | None, Column("bADE", "m", "lower", ".3f", group=_ALL)
    ] = None
    interval: Annotated[str | None, Column("95 %", "m", group=_ALL)] = None
    ranks: Annotated[str | None, Column("#", group=_ALL)] = None
    displacements: Annotated[str | None, Column("minADE/FDE", "m", group=_ALL)] = None
    coverage: Annotated[float | None, Column("cov.", "share", "higher", group=_ALL)] = (
        None
    )
    ids_error: Annotated[
        float | None, Column("bADE", "m", "lower", ".3f", group=_IDS)
    ] = None
    ids_interval: Annotated[str | None, Column("95 %", "m", group=_IDS)] = None
    ids_ranks: Annotated[str | None, Column("#", group=_IDS)] = None
    turning_error: Annotated[
        float | str | None,
        Column("bADE", "m", "lower", ".3f", group=NAMES["turning"], optional=True),
    ] = None


def main_table(report: Report) -> Table:
    """Table of bADE over all targets and on identity switches: a row per agent, the best first.

    An agent has its setting with the most hypotheses at equal k; `Report.shown` names the agents.
    """
    blocks = sorted(
        main_settings(report).values(),
        key=lambda of: (of["all"].error is None, of["all"].error or 0.0),
    )
    rows = [
        *map(_main_row, blocks),
        *(MainRow(agent, error=FAILED) for agent in report.failures),
    ]
    note = f"{MEANING} Budgets of false forecasts: {report.condition.get('budget', 'not stated')}."
    return Table(
        "main", f"{heading(report)}: m, less is better", note, rows, columns_of(MainRow)
    )


def heading(report: Report) -> str:
    """The place of a report, with the number of scenes and seeds."""
    counts = [
        text
        for row in report.rows[:1]
        for text in (counted(row.scenes, "scene"), counted(row.seeds, "seed"))
    ]
    return ", ".join([place_of(report), *counts])


def place_of(report: Report) -> str:
    """The env of a report, or the folder of own scenes."""
    if "folder" in report.condition:
        detections = report.condition["detections"]
        own = (
            "own detections" if detections.startswith("own detections") else detections
        )
        return f"{report.condition['folder']}, {own}"
    return report.env if shipped_env(report) else f"{report.env}, changed"


def shipped_env(report: Report) -> str:
    """The env whose numbers are comparable with those of ``report``; empty where its card is not the shipped one."""
    return unchanged(report.env, report.condition.get("card"))


def misstated_lines(report: Report) -> Iterator[str]:
    """Return the note about confidences that do not come true on other detections than the card's own.

    It is about the first agent: others have the same presence model, unless a run names one (``--presence``).
    """
    condition = report.condition
    card = load_card(report.env) if report.env in card_ids() else None
    other_detector = card is not None and card.detector_name != condition.get(
        "detector"
    )
    is_drive = (
        card is not None and card.drive is not None
    )  # its scenes are own ones, with the card's own detector
    if (
        is_drive
        or condition.get("presence")
        or not (other_detector or "folder" in condition)
    ):
        return
    for table in report.tables:
        if table.setting.observe != "truth" and (means := misstated(table)):
            yield (
                "! {}: the mean confidence is {:.2f}, and {:.2f} of the forecasts are of a true object: presence was "
                "not fitted to such detections. `mtp-bench train presence` fits a model, --presence FILE takes it, and "
                "--presence scores takes scores as they are".format(
                    table.setting.agent, *means
                )
            )
            return


def unchanged(env_id: str, digest: str | None) -> str:
    """``env_id``; empty where a card of this ``digest`` is not the one that ships.

    Own scenes, another split and other detections keep the name of the env, not its content.
    """
    return (
        env_id
        if env_id not in card_ids() or digest in (None, load_card(env_id).digest)
        else ""
    )


def blocks_of(report: Report) -> Iterator[Mapping[Subset, Row]]:
    """The rows of each agent and setting, by subset."""
    size = max(1, len({row.subset for row in report.rows}))
    for start in range(0, len(report.rows), size):
        yield {row.subset: row for row in report.rows[start : start + size]}


def main_settings(report: Report) -> dict[str, Mapping[Subset, Row]]:
    """Rows by subset of each agent's setting with the most hypotheses at equal k, and with its own parameters."""
    best: dict[str, Mapping[Subset, Row]] = {}
    for rows in blocks_of(report):
        name = rows["all"].agent.split(" ")[0]
        if not report.shown or name in report.shown:
            best[name] = max(
                best.get(name, rows), rows, key=lambda of: _preference(of["all"])
            )
    return best


def preference(
    budget: Budget, has_own_parameters: bool, hypotheses: int
) -> tuple[bool, bool, int]:
    """Sort key of the settings of one agent; the largest one is its main setting."""
    return budget == "equal", has_own_parameters, hypotheses


def _preference(row: Row) -> tuple[bool, bool, int]:
    return preference(row.budget, " " not in row.agent, row.hypotheses)


def _main_row(rows: Mapping[Subset, Row]) -> MainRow:
    row, ids, turning = rows["all"], rows["ids"], rows.get("turning")
    missing = row.minADE is None or row.minFDE is None
    return MainRow(
        agent=row.agent,
        hypotheses=row.hypotheses,
        error=row.error,
        interval=_ends(row),
        ranks=span_text(row.rank_range),
        displacements=None if missing else f"{row.minADE:.2f}/{row.minFDE:.2f}",
        coverage=row.coverage,
        ids_error=ids.error,
        ids_interval=_ends(ids),
        ids_ranks=span_text(ids.rank_range),
        turning_error=None if turning is None else turning.error,
    )


def _ends(row: Row) -> str | None:
    return None if row.interval is None else "{:.2f}–{:.2f}".format(*row.interval)
