"""Tables of figures."""

from __future__ import annotations

from typing import Any

from .scenes import Row


def show(title: str, rows: list[Row]) -> None:
    from rich.console import Console
    from rich.table import Table

    table, names = Table(), list(dict.fromkeys(name for row in rows for name in row))
    for name in names:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*(_shown(row.get(name)) for name in names))
    console = Console(width=180)
    console.print(f"\n{title}", style="bold", highlight=False)
    console.print(table)


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return (
            f"{value:,.0f}"
            if value >= 1000
            else f"{value:.1f}"
            if value >= 100
            else f"{value:.2f}"
        )
    return "" if value is None else str(value)
