"""A whole study, from the runs to the files that it writes."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

from ...cards import Card
from ...core import (
    MtpBenchError,
    Progress,
    Table,
    long_work,
    make_folder,
    require_folder,
    to_csv,
    to_json,
    write_bytes,
    write_text,
)
from ...running import (
    DEFAULTS,
    RunKeywords,
    RunOptions,
    frozen_reference,
    reference_for,
    resolve_options,
)
from ...sources import open_source
from .figures import make_figures
from .gallery import draw_worst_moments
from .page import study_page
from .plan import HYPOTHESES, key_of, make_plan
from .rows import make_tables
from .runs import RUNS, Findings, measure, open_bench

QUICK_SCENES = 6
QUICK_HYPOTHESES = (1, 5, 20)
TABLES, FIGURES, MOMENTS, PAGE = "tables", "figures", "moments", "index.html"
_MARK = ".study"  # file in every folder of a study
_OF_WEIGHTS = 5  # pieces of work per scene if event weights have to be made


@dataclass(frozen=True, eq=False)
class Study:
    """Results of a study, and its files."""

    folder: Path
    findings: Findings
    tables: dict[str, Table]
    page: Path
    figures: int


def study(
    names: Sequence[str],
    env_id: str | Card,
    folder: str | Path,
    options: RunOptions = DEFAULTS,
    quick: bool = False,
    command: str = "",
    **keywords: Unpack[RunKeywords],
) -> Study:
    """Study agents on the scenes of an env, and write the page, tables and figures into ``folder``.

    Args:
        names: Folders of submissions, or names of baselines; the story is about the first.
        env_id: Id of the env, path of its card, or a card.
        folder: Output; its runs of an earlier study are used again if nothing has changed.
        options: Data, scenes, seeds (all for ranked runs, the first for others), workers and progress.
        quick: A first look: the first scenes, one seed, fewer hypotheses.
        command: Command that makes the study again, shown on the page.
        keywords: As of `compare`, in place of options.

    Raises MtpBenchError for wrong arguments and broken data.
    """
    folder = Path(folder).absolute()
    require_study_folder(folder)
    env_id, options = resolve_options(env_id, options, keywords)
    place = Path(options.files).name if options.files else getattr(env_id, "id", env_id)
    with long_work(f"studying {place}", progress=options.progress) as progress:
        options = replace(options, progress=progress)
        findings = find(
            names, env_id, folder, quick_options(options) if quick else options, quick
        )
        progress.started(4)  # drawing takes a while, too
        tables = make_tables(findings)
        progress.done("tables")
        figures = write_study(folder, findings, tables, command, progress.done)
    return Study(folder, findings, tables, folder / PAGE, figures)


def quick_options(options: RunOptions) -> RunOptions:
    """Options for the first scenes and one seed."""
    return replace(
        options,
        seeds=options.seeds[:1],
        scenes=min(options.scenes or QUICK_SCENES, QUICK_SCENES),
    )


def find(
    names: Sequence[str],
    env_id: str | Card,
    folder: Path,
    options: RunOptions,
    quick: bool = False,
) -> Findings:
    """Run and score everything that a study needs; the progress counts all of it."""
    hypotheses = QUICK_HYPOTHESES if quick else HYPOTHESES
    card = options.card(env_id)
    card.require_same_scenes("of which there is no study")
    plan = make_plan(
        names, card, hypotheses, hypotheses[-1:] if quick else hypotheses[1:]
    )
    options.require_usable([setting.submission for setting in plan.equal])
    scenes = options.chosen(open_source(card, options.data).names)
    frozen = frozen_reference(card)
    weights = 0 if frozen is not None and frozen.holds(scenes) else _OF_WEIGHTS
    runs = len(plan.equal) * len(options.seeds) + len(plan.free)
    options.progress.started(len(scenes) * (1 + weights + runs))
    options = replace(
        options, progress=Progress(done=options.progress.done)
    )  # the parts are counted already
    bench = open_bench(env_id, folder, options)
    make_folder(folder)
    reference = reference_for(bench.card, bench.scenes, options)
    work = [(s, options.seeds) for s in plan.equal] + [
        (s, options.seeds[:1]) for s in plan.free
    ]
    measured = {
        key_of(setting): measure(bench, setting, seeds, options.progress.done)
        for setting, seeds in work
    }
    return Findings(bench, plan, reference, measured)


def require_study_folder(folder: Path) -> None:
    """Raise MtpBenchError unless ``folder`` is new, a study's, or holds runs alone: its other files are replaced."""
    require_folder(folder)
    if not folder.is_dir() or (folder / _MARK).is_file():
        return
    other = sorted(
        path.name
        for path in folder.iterdir()
        if path.name != RUNS and path.name[0] != "."
    )
    if other:
        raise MtpBenchError(
            f"{folder} holds {other[0]!r}, which is not of a study: choose another folder with -o"
        )


def write_study(
    folder: Path,
    findings: Findings,
    tables: dict[str, Table],
    command: str,
    done: Callable[[str], object],
) -> int:
    """Write all files of a study; returns the number of figures. ``done`` is called after each kind of file."""
    (folder / _MARK).touch()
    for name in (TABLES, FIGURES, MOMENTS):  # an earlier study may have had others
        shutil.rmtree(folder / name, ignore_errors=True)
        make_folder(folder / name)
    for table in tables.values():
        write_text(folder / TABLES / f"{table.name}.csv", to_csv(table))
        write_text(folder / TABLES / f"{table.name}.json", to_json(table))
    figures = make_figures(findings, tables)
    done("figures")
    for name, figure in figures.items():
        write_text(
            folder / FIGURES / f"{name}.svg",
            f'<?xml version="1.0" encoding="utf-8"?>\n{figure.svg}',
        )
        write_bytes(folder / FIGURES / f"{name}.png", figure.png)
    pictures = draw_worst_moments(findings, folder / MOMENTS)
    done("pictures of moments")
    write_text(folder / PAGE, study_page(findings, tables, figures, pictures, command))
    done("page")
    return len(figures)
