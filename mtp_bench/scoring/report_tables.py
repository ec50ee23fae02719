"""The content of a comparison and its main table: a row per agent, the best first."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Annotated, Any

from ..cards import load_card
from ..core import (
    Column,
    MtpBenchError,
    Table,
    card_ids,
    columns_of,
    counted,
    to_html,
    to_latex,
    to_markdown,
    to_text,
)
from .definitions import Subset
from .details import misstated
from .rank import span_text
from .rows import Budget, Details, PairedRow, Row
from .table import AgentTable, rows_per_scene

FAILED = "failed"  # in place of a number
MEANING = (
    "bADE (budgeted ADE): mean over targets and budgets of min(minADE, c), or c "
    "without a forecast. #: ranks in this run; –: saw the truth or too few objects."
)
SUBSET_NAMES: dict[Subset, str] = {
    "all": "all targets",
    "ids": "identity switch",
    "lost": "lost",
    "reacquired": "reacquired",
    "frag": "lost or reacquired",
    "paper_ids": "IDS as in the paper",
    "paper_frag": "FRAG as in the paper",
    "turning": "turning",
}
_ALL = SUBSET_NAMES["all"]
_IDS = SUBSET_NAMES["ids"]


@dataclass(frozen=True, eq=False, repr=False)
class Report:
    """The content of a comparison.

    None stands for undefined.
    """

    env: str
    definitions: str
    rows: list[Row]
    paired: list[PairedRow]  # differences to the controls
    details: list[Details]  # per agent
    # source, split, detector, card, detections, truth, weights, budget, presence; of
    # own scenes their folder
    condition: dict[str, str] = field(default_factory=dict)
    tables: Sequence[AgentTable] = ()  # sources of the rows, per agent
    shown: Sequence[str] = ()  # names of the agents of the main table; empty: all
    # agents that failed, which have no rows: where and why
    failures: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        table = to_text(main_table(self)).rstrip()
        return "\n".join([table, *self.notes(), *map(" ".join, self.failures.items())])

    __repr__ = __str__

    def notes(self) -> Iterator[str]:
        """Return the lines about agents that no reader may miss.

        Rows were rejected, or confidences do not come true.
        """
        for detail in self.details:
            rejected = sum(detail.invalid.values())
            if rejected:
                yield rejected_line(detail.agent, rejected)
        yield from misstated_lines(self)

    def _repr_html_(self) -> str:
        failures = [
            f"<p>{escape(' '.join(failure))}</p>" for failure in self.failures.items()
        ]
        return to_html(main_table(self)) + "".join(failures)

    def to_frame(self) -> Any:
        """Return the rows as a DataFrame, a column per key of ``compare --json``.

        It has a row per agent, setting and subset. Raises MtpBenchError if pandas is
        not installed.
        """
        records = [row.model_dump() for row in self.rows]
        return data_frame(records, list(Row.model_fields))

    def to_markdown(self) -> str:
        """Return the main table in Markdown."""
        return to_markdown(main_table(self))

    def to_latex(self) -> str:
        """Return the main table in LaTeX, for the package booktabs."""
        return to_latex(main_table(self))

    def per_scene(self) -> list[dict[str, Any]]:
        """Return the numbers of single scenes, as plain values.

        A row per agent, seed and scene; see `rows_per_scene`.
        """
        return list(rows_per_scene(self.tables))

    def to_json(self, *field_names: str) -> dict[str, Any]:
        """Return the content of ``compare --json``.

        It has env, definitions, rows, and the fields ``field_names``. The times of the
        agents, which differ from machine to machine, stand under their own key.
        """
        content: dict[str, Any] = {"env": self.env, "definitions": self.definitions}
        for name in ("rows", *field_names):
            part = getattr(self, name)
            if name not in ("condition", "failures"):  # a list of rows
                part = [row.model_dump(mode="json") for row in part]
            content[name] = part
        content["ms_per_frame"] = [row.pop("ms_per_frame") for row in content["rows"]]
        return content


def data_frame(
    records: Sequence[dict[str, Any]], columns: Sequence[str] | None = None
) -> Any:
    """Return records as a DataFrame; ``columns``: of one without records.

    Raises MtpBenchError if pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise MtpBenchError(
            "to_frame needs pandas, which is not installed: pip install pandas"
        ) from None
    return pandas.DataFrame(records, columns=columns)


def _agent_name(row: Row) -> str:
    """Return the agent's name in a row, without the parameters behind it."""
    return row.agent.split(" ")[0]


def rejected_line(agent: str, rejected: int) -> str:
    """Return the note about rejected rows of an agent's actions."""
    return (
        f"! {agent}: {counted(rejected, 'row')} rejected; "
        "`mtp-bench check` explains the errors"
    )


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
        Column(
            "bADE", "m", "lower", ".3f", group=SUBSET_NAMES["turning"], optional=True
        ),
    ] = None


def main_table(report: Report) -> Table:
    """Return the table of bADE over all targets and on identity switches.

    It has a row per agent, the best first. An agent has its setting with the most
    hypotheses at equal k; `Report.shown` names the agents.
    """

    # agents without bADE come last
    def sort_key(rows: Mapping[Subset, Row]) -> tuple[bool, float]:
        return rows["all"].error is None, rows["all"].error or 0.0

    settings = sorted(main_settings(report).values(), key=sort_key)
    rows = [_main_row(setting) for setting in settings]
    rows += [MainRow(agent, error=FAILED) for agent in report.failures]
    budget = report.condition.get("budget", "not stated")
    note = f"{MEANING} Budgets of false forecasts: {budget}."
    title = f"{heading(report)}: m, less is better"
    return Table("main", title, note, rows, columns_of(MainRow))


def heading(report: Report) -> str:
    """Return the place of a report, with the number of scenes and seeds."""
    if not report.rows:
        return place_of(report)
    scenes = counted(report.rows[0].scenes, "scene")
    seeds = counted(report.rows[0].seeds, "seed")
    return f"{place_of(report)}, {scenes}, {seeds}"


def place_of(report: Report) -> str:
    """Return the env of a report, or the folder of own scenes."""
    if "folder" in report.condition:
        detections = report.condition["detections"]
        if detections.startswith("own detections"):
            detections = "own detections"
        return f"{report.condition['folder']}, {detections}"
    return report.env if shipped_env(report) else f"{report.env}, changed"


def shipped_env(report: Report) -> str:
    """Return the env whose numbers are comparable with those of ``report``.

    Empty where its card is not the shipped one.
    """
    return shipped_env_id(report.env, report.condition.get("card"))


def misstated_lines(report: Report) -> Iterator[str]:
    """Return the note about confidences that do not come true.

    There is a note only if the detections are not the card's own. The note is about the
    first agent, since others have the same presence model unless a run names one
    (``--presence``).
    """
    condition = report.condition
    if condition.get("presence") or not _has_other_detections(report):
        return
    for table in report.tables:
        # these confidences are not of the presence model
        is_foreign = table.setting.observe in ("truth", "file")
        means = None if is_foreign else misstated(table)
        if means is not None:
            confidence, matched = means
            yield (
                f"! {table.setting.agent}: the mean confidence is {confidence:.2f}, "
                f"and {matched:.2f} of the forecasts are of a true object: presence "
                "was not fitted to such detections. `mtp-bench train presence` fits a "
                "model, --presence FILE takes it, and --presence scores takes scores "
                "as they are"
            )
            return


def _has_other_detections(report: Report) -> bool:
    if report.env in card_ids():
        card = load_card(report.env)
        # scenes of a closed loop are own ones, with the card's own detector
        if card.drive is not None:
            return False
        if card.detector_name != report.condition.get("detector"):
            return True
    return "folder" in report.condition


def shipped_env_id(env_id: str, digest: str | None) -> str:
    """Return ``env_id``, or "" if its card with this ``digest`` is changed.

    Own scenes, another split and other detections keep the name of the env, not its
    content. A digest of None is not known, and counts as unchanged.
    """
    # an id that does not ship is that of a user's own card
    if env_id not in card_ids() or digest in (None, load_card(env_id).digest):
        return env_id
    return ""


def blocks_of(report: Report) -> Iterator[Mapping[Subset, Row]]:
    """Return the rows of each agent and setting, by subset."""
    # they follow each other, one per subset
    size = max(1, len({row.subset for row in report.rows}))
    for start in range(0, len(report.rows), size):
        yield {row.subset: row for row in report.rows[start : start + size]}


def main_settings(report: Report) -> dict[str, Mapping[Subset, Row]]:
    """Return the rows by subset of each agent's main setting.

    Settings with the env's k samples come before others, then those with the agent's
    own parameters, then those with the most hypotheses.
    """

    def sort_key(rows: Mapping[Subset, Row]) -> tuple[bool, bool, int]:
        row = rows["all"]
        has_own_parameters = row.agent == _agent_name(row)
        return preference(row.budget, has_own_parameters, row.hypotheses)

    settings: dict[str, Mapping[Subset, Row]] = {}
    for rows in blocks_of(report):
        agent = _agent_name(rows["all"])
        if not report.shown or agent in report.shown:
            settings[agent] = max(settings.get(agent, rows), rows, key=sort_key)
    return settings


def preference(
    budget: Budget, has_own_parameters: bool, hypotheses: int
) -> tuple[bool, bool, int]:
    """Return the sort key of an agent's settings, the largest for the main one."""
    return budget == "equal", has_own_parameters, hypotheses


def _main_row(rows: Mapping[Subset, Row]) -> MainRow:
    row = rows["all"]
    ids_row = rows["ids"]
    displacements = None
    if row.minADE is not None and row.minFDE is not None:
        displacements = f"{row.minADE:.2f}/{row.minFDE:.2f}"
    return MainRow(
        agent=row.agent,
        hypotheses=row.hypotheses,
        error=row.error,
        interval=_interval_text(row),
        ranks=span_text(row.rank_range),
        displacements=displacements,
        coverage=row.coverage,
        ids_error=ids_row.error,
        ids_interval=_interval_text(ids_row),
        ids_ranks=span_text(ids_row.rank_range),
        turning_error=rows["turning"].error if "turning" in rows else None,
    )


def _interval_text(row: Row) -> str | None:
    return None if row.interval is None else "{:.2f}–{:.2f}".format(*row.interval)
