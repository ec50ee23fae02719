"""Tables of a study: those of ``compare --full``, the agents' events, and samples."""

from collections.abc import Iterator

from ...core import Column, Table
from ...scoring import AgentSetting, Report, main_table
from ..terminal.tables import data_table, full_tables

_SETTING_COLUMNS = tuple(
    Column(key=key, heading=heading)
    for key, heading in zip(AgentSetting.model_fields, ("", "H", "K", ""), strict=True)
)


def study_tables(report: Report) -> list[Table]:
    """Return the tables of a study; the last one has every number of the report."""
    return [
        main_table(report),
        *full_tables(report),
        _event_table(report),
        _sample_table(report),
        data_table(report),
    ]


def _event_table(report: Report) -> Table:
    """Return the agents' own events, on targets or not, in the first seed."""
    rows = []
    for details in report.details:
        setting = {key: getattr(details, key) for key in AgentSetting.model_fields}
        in_all_hypotheses = details.own["all_h_ids"].targets
        rows.append(setting | details.own_events | {"all_h_ids": in_all_hypotheses})
    columns = (
        *_SETTING_COLUMNS,
        Column("identity switches", key="ids"),
        Column(key="lost"),
        Column("lost, track elsewhere", key="wrong"),
        Column(key="reacquired"),
        Column("targets with a switch in all H", key="all_h_ids"),
    )
    return Table("events", "Events of each agent's own tracks", "", rows, columns)


def _sample_table(report: Report) -> Table:
    """Return expected minADE of k random samples out of the K of each setting."""
    columns = (*_SETTING_COLUMNS, Column(key="k"), Column(key="minADE", unit="m"))
    title = "Expected minADE of k random samples out of K (all targets, m)"
    return Table("samples", title, "", list(_sample_rows(report)), columns)


def _sample_rows(report: Report) -> Iterator[dict[str, object]]:
    for details in report.details:
        setting = {key: getattr(details, key) for key in AgentSetting.model_fields}
        for k, minade_m in details.k_curve.items():
            yield setting | {"k": int(k), "minADE": minade_m}
