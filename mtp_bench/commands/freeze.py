"""``mtp-bench maintain freeze``."""

from __future__ import annotations

from ..running.reference import freeze as write
from ..viz.terminal.output import counted, show
from .options import DataOption, EnvOption, EnvScenes, JobsOption, WorkerChoice
from .output import prepare, working


def freeze(env: EnvOption, root: DataOption = None, jobs: JobsOption = 0) -> None:
    """Write the frozen event weights of a shipped environment (maintainers)."""
    options = EnvScenes(env, root).options(WorkerChoice(jobs))
    prepare(env, options)
    with working("freeze", options) as watched:
        path, reference = write(env, watched)
    totals = ", ".join(f"{name} {total}" for name, total in reference.totals["sum_of_weights"].items())
    show(f"{path}: {counted(reference.totals['targets'], 'target')}, sum of weights {totals}; hash {reference.digest}")
