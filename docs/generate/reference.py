"""The pages of the reference: every name for users, from the docstrings.

Names of `mtp_bench` are found there, so none can be forgotten. Of the rooms, whose facades also serve other rooms, the
names for users are listed here.
"""

from __future__ import annotations

import ast
import importlib
import inspect
from dataclasses import dataclass

from .outputs import EXAMPLES, OUTPUTS

PACKAGES = {
    "wrappers": "AssociationOnly PerDetection CONTINUE IGNORE NEW",
    "tracking": "GivenTracker TruthTracker k_best BirdsEye OnlineDetections"
    " OnlineTracker ClassParameters detector_parameters score_thresholds"
    " HypothesisTracker",
    "prediction": "GreedySampler KMeansSampler NoiseTable stored_noise HedgedPredictor"
    " KinematicPredictor LanePredictor local_future local_inputs to_absolute"
    " LearnedPredictor LearnedPresence TrackWindows windows_of",
    "training": "Windows windows",
    "scoring": "DEFINITIONS SUBSETS end_to_end_accuracy"
    " forecast_average_precision Displacement displacement energy_score k_curve"
    " history FrameScore FrameScorer match match_sticky evaluated"
    " Pairs References rank_by_error Report summarise SceneScore"
    " mean_plain_error score_scene bootstrap_interval effective_number"
    " paired_difference AgentScores stated_hypotheses Targets find_targets live_frames"
    " Reference read_reference write_reference",
}


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
        ("env", "cards", "core.bundle", "agent.building"),
        intro="Names that make environments, read their cards and fill actions.",
        beside=(
            "mtp_bench.env.arguments.EnvKeywords",
            "mtp_bench.cards.changes.ChangeKeywords",
        ),
    ),
    Group(
        "Agents",
        "agents",
        ("agent", "core.tracks"),
        intro="Interfaces of an agent and of its parts.",
    ),
    Group(
        "Records",
        "records",
        ("core.arrays", "core.rollout", "core.scenes", "core.task", "sources"),
        intro="Arrays of scenes, observations, actions and rollouts.",
        beside=("mtp_bench.core.arrays.Ragged",),
    ),
    Group(
        "Running and training",
        "running",
        ("running", "scoring", "training"),
        intro="Functions that run, compare and score agents, and that read what a model is trained on.",
        beside=(
            "mtp_bench.running.options.RunKeywords",
            "mtp_bench.scoring.table.SceneResult",
            "mtp_bench.running.comparison.Comparison",
            "mtp_bench.running.options.RunOptions",
            "mtp_bench.core.parallel.Workers",
            "mtp_bench.running.stored.StoredRun",
        ),
    ),
    Group(
        "Conformance",
        "testing",
        ("running.conformance",),
        intro="Checks that an agent or a card keeps the contract.",
        beside=("mtp_bench.running.conformance_playing.Finding",),
    ),
    Group(
        "Errors",
        "errors",
        ("core.errors",),
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
    """Names for users that a room of `mtp_bench` offers, sorted."""
    return sorted(PACKAGES[package].split())


def _index() -> str:
    """The first page: what is where, and the letters of shapes."""
    lines = [
        f"- [{group.title}]({group.place}.md): {_intro(group)}"
        for group in GROUPS
        if _names(group)
    ]
    legend = inspect.cleandoc(
        importlib.import_module("mtp_bench.core.arrays").__doc__ or ""
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


def _group_of(name: str) -> Group:
    """The page of a name of `mtp_bench`, by its module; type aliases are records."""
    value = getattr(importlib.import_module("mtp_bench"), name)
    module = getattr(value, "__module__", "")
    if not module.startswith("mtp_bench."):
        module = "mtp_bench.core.arrays"
    place = module.removeprefix("mtp_bench.") + "."
    for group in GROUPS:
        if any(place.startswith(f"{part}.") for part in group.modules):
            return group
    return OTHERS
