"""Multi-hypothesis tracking and prediction of what is likely to be there."""

import tomllib
from pathlib import Path

from mtp_bench import Agent, Pipeline, Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.tracking import HypothesisTracker


def build(task: Task, hypotheses: int = 20) -> Agent:
    """Objects are reported from the score on that `operating_points.toml` gives for the env and their class.

    In an env that is not in the file everything is reported, as by mtp.
    """
    points = tomllib.loads((Path(__file__).parent / "operating_points.toml").read_text(encoding="utf-8"))
    least = points.get(task.env_id, {})
    return Pipeline(HypothesisTracker(hypotheses), KinematicPredictor(), KMeansSampler(), min_score=least)
