"""Tables of a study: those of ``compare --full``, events and samples."""

from ...core import Column, Table, columns_of
from ...scoring import AgentSetting, Details, Report, main_table
from ..terminal.tables import data_table, full_tables

_SETTING_COLUMNS = columns_of(AgentSetting)


def study_tables(report: Report) -> dict[str, Table]:
    """Return the tables by name. The last has every number."""
    tables = (
        main_table(report),
        *full_tables(report),
        _event_table(report),
        _sample_table(report),
        data_table(report),
    )
    return {table.name: table for table in tables}


def _event_table(report: Report) -> Table:
    """Return the agents' own events in the first seed."""
    rows = []
    for details in report.details:
        in_all_hypotheses = {"all_h_ids": details.own["all_h_ids"].targets}
        rows.append(_setting(details) | details.own_events | in_all_hypotheses)
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
    """Return expected minADE of k random samples of each setting."""
    rows = []
    for details in report.details:
        for k, minade_m in details.k_curve.items():
            rows.append(_setting(details) | {"k": int(k), "minADE": minade_m})
    columns = (*_SETTING_COLUMNS, Column(key="k"), Column(key="minADE", unit="m"))
    title = "Expected minADE of k random samples out of K (all targets, m)"
    return Table("samples", title, "", rows, columns)


def _setting(details: Details) -> dict[str, object]:
    return {key: getattr(details, key) for key in AgentSetting.model_fields}
