"""Tables: columns that are declared once, rows, and writers of text, HTML, CSV, JSON, Markdown and LaTeX.

The fields of a row declare the columns:

    @dataclass(frozen=True)
    class Cost:
        agent: Annotated[str, Column()]
        error: Annotated[float | None, Column("error", "m", better="lower")]
        interval: Annotated[tuple[float, float] | None, Column(interval=True)] = None

    to_csv(Table("costs", "Costs", "What an agent costs.", rows))
"""

from .table import BLANK as BLANK
from .table import Column as Column
from .table import Table as Table
from .table import Value as Value
from .table import columns_of as columns_of
from .table import counted as counted
from .table import short as short
from .writers import SUFFIXES as SUFFIXES
from .writers import tables_text as tables_text
from .writers import to_csv as to_csv
from .writers import to_html as to_html
from .writers import to_json as to_json
from .writers import to_latex as to_latex
from .writers import to_markdown as to_markdown
from .writers import to_text as to_text
