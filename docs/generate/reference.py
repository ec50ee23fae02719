"""The pages of the reference: every public name, from the docstrings.

Names are found in the packages themselves, so none can be forgotten; only the titles of the pages are written here.
"""

from __future__ import annotations

import ast
import importlib
import inspect
from dataclasses import dataclass
from typing import Any

from .outputs import EXAMPLES, OUTPUTS

PACKAGES = ("wrappers", "tracking", "prediction", "training", "scoring", "testing")


@dataclass(frozen=True)
class Group:
    """A page: public names of `mtp_bench` whose code lies in some modules, or all of one package."""

    title: str
    place: str
    modules: tuple[str, ...] = ()  # of mtp_bench
    package: str = ""
    intro: str = ""
    beside: tuple[
        str, ...
    ] = ()  # what the names of the page take or give, by its full name


OTHERS = Group("Others", "others", intro="Public names beside these.")
GROUPS = (
    Group(
        "Environment",
        "environment",
        ("env", "cards", "_bundle"),
        intro="Names that make environments, read their cards and fill actions.",
        beside=(
            "mtp_bench.env.arguments.EnvKeywords",
            "mtp_bench.cards.changes.ChangeKeywords",
        ),
    ),
    Group(
        "Agents",
        "agents",
        ("agent", "tracks", "submission"),
        intro="Interfaces of an agent and of its parts.",
    ),
    Group(
        "Records",
        "records",
        ("types", "sources"),
        intro="Arrays of scenes, observations, actions and rollouts.",
        beside=("mtp_bench.core.types.Ragged",),
    ),
    Group(
        "Running and training",
        "running",
        ("running", "scoring", "training"),
        intro="Functions that run, compare and score agents, and that read what a model is trained on.",
        beside=(
            "mtp_bench.running.options.RunKeywords",
            "mtp_bench.scoring.scenes.SceneResult",
            "mtp_bench.running.comparison.Comparison",
            "mtp_bench.running.options.RunOptions",
            "mtp_bench.core.parallel.Workers",
            "mtp_bench.running.stored.StoredRun",
        ),
    ),
    Group(
        "Errors",
        "errors",
        ("errors",),
        intro="Every error that a user can cause is an `MtpBenchError`.",
    ),
    OTHERS,
    *(Group(f"mtp_bench.{name}", name, package=name) for name in PACKAGES),
)


INDEX = "reference/index.md"
HEAD = """\
# Reference

`import mtp_bench` gives the public names. What takes time to import is imported when it is first used.
"""
LEGEND = """
Shapes of arrays are in these letters:

"""


def navigation() -> list[str | dict[str, str]]:
    """The pages in the order of the navigation; a page without names is left out."""
    return [INDEX, *({group.title: _place(group)} for group in GROUPS if _names(group))]


def pages() -> dict[str, str]:
    """Place and Markdown of every page."""
    return {
        INDEX: _index(),
        **{_place(group): _page(group) for group in GROUPS if _names(group)},
    }


def public_names() -> list[str]:
    """Names of `mtp_bench` other than modules, sorted."""
    root = importlib.import_module("mtp_bench")
    names = [name for name in dir(root) if not name.startswith("_")]
    return [name for name in names if not inspect.ismodule(getattr(root, name))]


def names_of(package: str) -> list[str]:
    """Names that a package of `mtp_bench` offers, sorted."""
    module = importlib.import_module(f"mtp_bench.{package}")
    return sorted(name for name, value in vars(module).items() if _offered(name, value))


def _index() -> str:
    """The first page: what is where, and the letters of shapes."""
    lines = [
        f"- [{group.title}]({group.place}.md): {_intro(group)}"
        for group in GROUPS
        if _names(group)
    ]
    legend = inspect.cleandoc(
        importlib.import_module("mtp_bench.core.types").__doc__ or ""
    ).split("\n\n", 1)[1]
    return (
        HEAD
        + "\n"
        + "\n".join([*lines, "- [Commands](commands.md): `mtp-bench`"])
        + "\n"
        + LEGEND
        + legend
        + "\n"
    )


def _intro(group: Group) -> str:
    return " ".join((group.intro or _docstring(f"mtp_bench.{group.package}")).split())


def _place(group: Group) -> str:
    return f"reference/{group.place}.md"


def example(place: str) -> str:
    """The example of a page: a sentence, the code, and what it prints."""
    code = (EXAMPLES / f"reference/{place}.py").read_text()
    sentence = ast.get_docstring(ast.parse(code))
    code = code.split('"""', 2)[2].strip()
    output = (OUTPUTS / f"reference/{place}.txt").read_text().strip()
    return f"## Example\n\n{sentence}\n\n```python\n{code}\n```\n\nIt prints:\n\n```text\n{output}\n```"


def _page(group: Group) -> str:
    whole = f"mtp_bench.{group.package}" if group.package else "mtp_bench"
    lines = [f"# {group.title}", _intro(group), example(group.place)]
    names = [*(f"{whole}.{name}" for name in _names(group)), *group.beside]
    return "\n\n".join([*lines, *(f"::: {name}" for name in names)]) + "\n"


def _docstring(module: str) -> str:
    return inspect.cleandoc(importlib.import_module(module).__doc__ or "").split(
        "\n\n"
    )[0]


def _names(group: Group) -> list[str]:
    """Names of a page, sorted."""
    if group.package:
        return names_of(group.package)
    return [name for name in public_names() if _group_of(name) is group]


def _offered(name: str, value: Any) -> bool:
    """True for a public name of a package that is not a module and not a name of Python."""
    return (
        not name.startswith("_")
        and not inspect.ismodule(value)
        and name != "annotations"
    )


def _group_of(name: str) -> Group:
    """The page of a name of `mtp_bench`, by the module that its code lies in; type aliases are records."""
    value = getattr(importlib.import_module("mtp_bench"), name)
    module = getattr(value, "__module__", "mtp_bench.core.types")
    part = (
        module if module.startswith("mtp_bench.") else "mtp_bench.core.types"
    ).split(".")[1]
    return next((group for group in GROUPS if part in group.modules), OTHERS)
