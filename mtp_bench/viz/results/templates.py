"""Templates of pages of results: Jinja without escapes of HTML, for the pages are Markdown."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import MtpBenchError
from . import conditions
from .figures import Figures
from .known import Known
from .table import Tables, cell, label

if TYPE_CHECKING:
    from jinja2 import Environment

SUFFIX = ".jinja"
_CONDITIONS = ("above", "below", "within", "significant", "chance", "all_of", "verdict", "claim")


def functions_of(known: Known) -> Mapping[str, Any]:
    """What templates may call, by name."""
    figures, tables = Figures(known), Tables(known)
    own = {name: getattr(figures, name) for name in dir(Figures) if not name.startswith("_")}
    judged = {name: getattr(conditions, name) for name in _CONDITIONS}
    return {
        **own, **judged, "has": known.has, "present": known.present, "complete": known.complete,
        "table": tables.table, "across": tables.across, "label": label,
    }  # fmt: skip


def render(template: Path, functions: Mapping[str, Any]) -> str:
    """The text of a template.

    Raises MtpBenchError with its name and line for a template that is broken, a figure that is not there and a claim
    that does not hold.
    """
    from jinja2 import TemplateError, TemplateNotFound

    try:
        return _environment(template.parent, functions).get_template(template.name).render()
    except TemplateNotFound as error:
        raise MtpBenchError(f"{template}: no such template ({error.name})") from None
    except (TemplateError, MtpBenchError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise MtpBenchError(f"{_place(error, template)}: {error}") from None


def _environment(folder: Path, functions: Mapping[str, Any]) -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(folder), autoescape=False, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.globals.update(functions)
    environment.filters["cell"] = cell
    return environment


def _place(error: Exception, template: Path) -> str:
    """The template and the line of it that an error is about."""
    line = getattr(error, "lineno", None)  # of a template that cannot be read
    name = getattr(error, "filename", None) or str(template)
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename.endswith(SUFFIX):
            name, line = frame.filename, frame.lineno
    return f"{name}, line {line}" if line else name
