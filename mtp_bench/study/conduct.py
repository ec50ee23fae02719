"""A whole study, from the runs to the files that it writes."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..cards import Card
from ..errors import MtpBenchError
from ..files import make_folder, require_folder, write_bytes, write_text
from ..parallel import Done, Progress
from ..running.compare import AtThreshold, at_threshold, scores_of, threshold_agents
from ..running.options import DEFAULTS, RunOptions
from ..running.perturbation import score_cuts
from ..running.reference import frozen_reference, reference_for
from ..running.settings import setting_of
from ..scoring import Reference, summarise
from ..sources import open_source
from ..submission.loader import load_submission
from ..tables import Table, to_csv, to_json
from .findings import Findings
from .plan import HYPOTHESES, QUANTILES, StudyPlan, key_of, make_plan, with_cuts
from .runs import RUNS, Bench, Measured, measure, open_bench, speed_of
from .specs import make_tables

QUICK_SCENES = 6
QUICK_HYPOTHESES = (1, 5, 20)
TABLES, FIGURES, EVENTS, PAGE = "tables", "figures", "events", "index.html"
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
) -> Study:
    """Study agents on the scenes of an env, and write the page, tables and figures into ``folder``.

    Args:
        names: Folders of submissions, or names of baselines; the story is about the first.
        env_id: Id of the env, path of its card, or a card.
        folder: Output; its runs of an earlier study are used again if nothing has changed.
        options: Data, scenes, seeds (all for ranked runs, the first for others), workers and progress.
        quick: A first look: the first scenes, one seed, fewer hypotheses, no score thresholds.
        command: Command that makes the study again, shown on the page.

    Raises MtpBenchError for wrong arguments and broken data.
    """
    folder = Path(folder).absolute()
    require_study_folder(folder)
    findings = find(names, env_id, folder, quick_options(options) if quick else options, quick)
    options.progress.started(4)  # drawing takes a while, too
    tables = make_tables(findings)
    options.progress.done("tables")
    figures = write_study(folder, findings, tables, command, options.progress.done)
    return Study(folder, findings, tables, folder / PAGE, figures)


def quick_options(options: RunOptions) -> RunOptions:
    """Options for the first scenes and one seed."""
    return replace(options, seeds=options.seeds[:1], scenes=min(options.scenes or QUICK_SCENES, QUICK_SCENES))


def find(names: Sequence[str], env_id: str | Card, folder: Path, options: RunOptions, quick: bool = False) -> Findings:
    """Run and score everything that a study needs; the progress counts all of it."""
    hypotheses = QUICK_HYPOTHESES if quick else HYPOTHESES
    card = options.card(env_id)
    plan = make_plan(names, card, hypotheses, hypotheses[-1:] if quick else hypotheses[1:])
    options.require_tracks_used([setting.submission for setting in plan.equal])
    scenes = options.chosen(open_source(card, options.data).names)
    frozen = frozen_reference(card)
    weights = 0 if frozen is not None and frozen.holds(scenes) else _OF_WEIGHTS
    cuts = 0 if quick else len(QUANTILES) * len(threshold_agents())
    runs = len(plan.equal) * len(options.seeds) + len(plan.free) + cuts
    options.progress.started(len(scenes) * (1 + weights + runs))
    options = replace(options, progress=Progress(done=options.progress.done))  # the parts are counted already
    bench = open_bench(env_id, folder, options)
    make_folder(folder)
    plan = plan if quick else with_cuts(plan, bench.card, _cuts(bench))
    reference = reference_for(bench.card, bench.scenes, options)
    work = [(s, options.seeds) for s in plan.equal] + [(s, options.seeds[:1]) for s in [*plan.free, *plan.cut]]
    measured = {key_of(setting): measure(bench, setting, seeds, options.progress.done) for setting, seeds in work}
    speed = tuple(speed_of(bench, setting) for setting in plan.subjects[0].equal.values())
    return Findings(bench, plan, reference, measured, speed, _scores_at_cuts(bench, plan, reference, measured))


def _cuts(bench: Bench) -> dict[float, dict[str, float]]:
    """Least scores per class, by the share of true detections that they leave out."""
    classes = bench.card.task.classes
    return {
        share: dict(zip(classes, score_cuts(bench.matched, len(classes), share), strict=True)) for share in QUANTILES
    }


def _scores_at_cuts(
    bench: Bench, plan: StudyPlan, reference: Reference, measured: dict[str, Measured]
) -> tuple[AtThreshold, ...]:
    """Scores of the baselines with all detections, and with each score threshold."""
    if not plan.cuts:
        return ()
    uncut = tuple(setting_of(load_submission(name), bench.card) for name in threshold_agents())
    rows = []
    for share, settings in {0.0: uncut, **plan.cuts}.items():
        if all(key_of(setting) in measured for setting in settings):
            agents = [scores_of(each, measured[key_of(each)].scores[:1], each.submission.name) for each in settings]
            rows.append(at_threshold(share, agents, summarise(agents, bench.card, reference)))
    return tuple(rows)


def require_study_folder(folder: Path) -> None:
    """Raise MtpBenchError unless ``folder`` is new, a study's, or holds runs alone: its other files are replaced."""
    require_folder(folder)
    if not folder.is_dir() or (folder / _MARK).is_file():
        return
    other = sorted(path.name for path in folder.iterdir() if path.name != RUNS and path.name[0] != ".")
    if other:
        raise MtpBenchError(f"{folder} holds {other[0]!r}, which is not of a study: choose another folder with -o")


def write_study(folder: Path, findings: Findings, tables: dict[str, Table], command: str, done: Done) -> int:
    """Write all files of a study; returns the number of figures. ``done`` is called after each kind of file."""
    from .figures import make_figures
    from .gallery import gallery
    from .page import study_page

    (folder / _MARK).touch()
    for name in (TABLES, FIGURES, EVENTS):  # an earlier study may have had others
        shutil.rmtree(folder / name, ignore_errors=True)
        make_folder(folder / name)
    for table in tables.values():
        write_text(folder / TABLES / f"{table.name}.csv", to_csv(table))
        write_text(folder / TABLES / f"{table.name}.json", to_json(table))
    figures = make_figures(findings, tables)
    done("figures")
    pictures = gallery(findings)
    named = [(FIGURES, figure) for figure in figures.values()] + [(EVENTS, picture.figure) for picture in pictures]
    for name, figure in named:
        write_text(folder / name / f"{figure.name}.svg", figure.svg_file)
        write_bytes(folder / name / f"{figure.name}.png", figure.png)
    for picture in pictures:
        write_bytes(folder / EVENTS / f"{picture.figure.name}-focus.png", picture.focus)
    done("pictures of events")
    write_text(folder / PAGE, study_page(findings, tables, figures, pictures, command))
    done("page")
    return len(figures)
