"""``mtp-bench freeze``, for maintainers."""

from __future__ import annotations

from .options import DataOption, EnvOption, EnvScenes, JobsOption, WorkerChoice
from .output import prepare, working


def freeze(env: EnvOption, root: DataOption = None, jobs: JobsOption = 0) -> None:
    """Write the frozen subsets of a shipped environment (maintainers)."""
    from ..running.reference import freeze as write
    from ..viz.terminal.output import show

    options = EnvScenes(env, root).options(WorkerChoice(jobs))
    prepare(env, options)
    with working("freeze", options) as watched:
        path, counts = write(env, watched)
    show(f"{path}: {counts}")
