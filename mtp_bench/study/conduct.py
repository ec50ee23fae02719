"""A whole study, from nothing to its page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..cards import Card
from ..files import make_folder
from ..parallel import Progress
from ..running.compare import AtThreshold, at_threshold, scores_of, threshold_agents
from ..running.options import DEFAULTS, RunOptions
from ..running.perturbation import score_cuts
from ..running.reference import frozen_reference, reference_for
from ..running.settings import setting_of
from ..scoring import Reference, summarise
from ..sources import open_source
from ..submission.loader import load_submission
from .findings import Findings
from .plan import HYPOTHESES, QUANTILES, Plan, key_of, make_plan, with_cuts
from .runs import Bench, Measured, measure, open_bench
from .speed import speed_of
from .table import Table
from .tables import make_tables

QUICK_SCENES = 6
QUICK_HYPOTHESES = (1, 5, 20)
_OF_WEIGHTS = 5  # pieces of work per scene where event weights have to be made


@dataclass(frozen=True, eq=False)
class Study:
    """What was found, and where it lies."""

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
        folder: Where everything goes; runs that lie there already are used where nothing has changed.
        options: Data, scenes, seeds (what ranks is run with all, the rest with the first), workers and progress.
        quick: A first look: the first scenes, one seed, fewer hypotheses, no cuts of the input.
        command: That makes the study again; the page tells it.

    Raises MtpBenchError for whatever the user can mend.
    """
    from .write import PAGE, require_study_folder, write_study

    folder = Path(folder).absolute()
    require_study_folder(folder)
    found = find(names, env_id, folder, quick_options(options) if quick else options, quick)
    options.progress.started(4)  # drawing takes a while, too
    tables = make_tables(found)
    options.progress.done("tables")
    figures = write_study(folder, found, tables, command, options.progress.done)
    return Study(folder, found, tables, folder / PAGE, figures)


def quick_options(options: RunOptions) -> RunOptions:
    """The first scenes and one seed."""
    return replace(options, seeds=options.seeds[:1], scenes=min(options.scenes or QUICK_SCENES, QUICK_SCENES))


def find(names: Sequence[str], env_id: str | Card, folder: Path, options: RunOptions, quick: bool = False) -> Findings:
    """Run and score everything that a study needs; one count of the work goes over all of it."""
    hypotheses = QUICK_HYPOTHESES if quick else HYPOTHESES
    card = options.card(env_id)
    plan = make_plan(names, card, hypotheses, hypotheses[-1:] if quick else hypotheses[1:])
    options.require_tracks_used([setting.submission for setting in plan.equal])
    scenes = options.chosen(open_source(card, options.data).names)
    cuts = 0 if quick else len(QUANTILES) * len(threshold_agents())
    frozen = frozen_reference(card)
    weights = 0 if frozen is not None and frozen.holds(scenes) else _OF_WEIGHTS
    runs = len(plan.equal) * len(options.seeds) + len(plan.free) + cuts
    options.progress.started(len(scenes) * (1 + weights + runs))
    watched = replace(options, progress=Progress(done=options.progress.done))  # its parts do not count anew
    bench = open_bench(env_id, folder, watched)
    make_folder(folder)
    plan = plan if quick else with_cuts(plan, bench.card, _cuts(bench))
    reference = reference_for(bench.card, bench.scenes, watched)
    measured = _measure_all(bench, plan)
    subject = plan.subjects[0]
    speeds = tuple(speed_of(bench, setting) for setting in subject.equal.values())
    return Findings(bench, plan, reference, measured, speeds, _sensitivity(bench, plan, reference, measured))


def _measure_all(bench: Bench, plan: Plan) -> dict[str, Measured]:
    first = bench.options.seeds[:1]
    work = [(s, bench.options.seeds) for s in plan.equal] + [(s, first) for s in [*plan.free, *plan.cut]]
    return {key_of(setting): measure(bench, setting, seeds, bench.options.progress.done) for setting, seeds in work}


def _cuts(bench: Bench) -> dict[float, dict[str, float]]:
    """Least scores per class, by the share of true detections that lie below."""
    classes = bench.card.task.classes
    return {
        share: dict(zip(classes, score_cuts(bench.matched, len(classes), share), strict=True)) for share in QUANTILES
    }


def _sensitivity(
    bench: Bench, plan: Plan, reference: Reference, measured: dict[str, Measured]
) -> tuple[AtThreshold, ...]:
    """What the baselines score with all detections, and at each cut."""
    if not plan.cuts:
        return ()
    whole = [setting_of(load_submission(name), bench.card) for name in threshold_agents()]
    at = {0.0: whole, **plan.cuts} if all(key_of(setting) in measured for setting in whole) else plan.cuts
    rows = []
    for share, settings in at.items():
        agents = [scores_of(each, measured[key_of(each)].scores[:1], each.submission.name) for each in settings]
        rows.append(at_threshold(share, agents, summarise(agents, bench.card, reference)))
    return tuple(rows)
