"""The tables of a study, in the order of its story."""

from __future__ import annotations

from ..findings import Findings
from ..relations import relation_table
from ..table import Table
from .costs import budget_table, cut_table, gap_table, k_table, knee_table, surface_table
from .events import distance_table, frame_table, frequency_table, shared_table
from .others import people_table, speed_table
from .paper import everything_table, past_table, targeted_table
from .where import age_table, bin_table, calibration_table, cause_table, since_table

ALL = (
    past_table,
    frequency_table,
    distance_table,
    targeted_table,
    everything_table,
    shared_table,
    frame_table,
    speed_table,
    surface_table,
    k_table,
    knee_table,
    cause_table,
    gap_table,
    since_table,
    age_table,
    bin_table,
    budget_table,
    calibration_table,
    cut_table,
    people_table,
    relation_table,
)


def make_tables(found: Findings) -> dict[str, Table]:
    """Every table that has rows, by name."""
    tables = [make(found) for make in ALL]
    return {table.name: table for table in tables if table.rows}
