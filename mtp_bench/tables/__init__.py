"""Tables: columns that are declared once, rows, and writers of text, HTML, CSV, JSON, Markdown and LaTeX.

The fields of a row declare the columns:

    @dataclass(frozen=True)
    class Cost:
        agent: Annotated[str, Column()]
        error: Annotated[float | None, Column("error", "m", better="lower")]
        interval: Annotated[tuple[float, float] | None, Column(interval=True)] = None

    to_csv(Table("costs", "Costs", "What an agent costs.", rows))
"""

from .table import (
    BLANK as BLANK,
    Column as Column,
    Table as Table,
    Value as Value,
    columns_of as columns_of,
    counted as counted,
    short as short,
)
from .writers import (
    SUFFIXES as SUFFIXES,
    tables_text as tables_text,
    to_csv as to_csv,
    to_html as to_html,
    to_json as to_json,
    to_latex as to_latex,
    to_markdown as to_markdown,
    to_text as to_text,
)
