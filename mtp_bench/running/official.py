"""Numbers of official programs for the forecasts of a stored run on nuScenes."""

from ..cards import Card
from ..core import CardError
from ..scoring import OFFICIAL_STEPS, OfficialRow, official_rows, official_scene
from ..sources import NuScenes, NuScenesSource
from .stored import OpenedRun


def official_scores(opened: OpenedRun) -> list[OfficialRow]:
    """Return the numbers of MFEval and UniAD for the scenes of a run.

    Raises CardError as `require_nuscenes`, and MissingDataError without the targets of
    the prediction challenge.
    """
    card = opened.card
    require_nuscenes(card)
    source = NuScenes(card, opened.data)
    scenes = []
    for rollout in opened.run.rollouts:
        scene = opened.recorded(rollout.scene)
        truth = source.listed_truth(rollout.scene)
        scenes.append(official_scene(rollout, card.task.classes, scene, *truth))
    return official_rows(opened.run.info.agent, scenes)


def require_nuscenes(card: Card) -> None:
    """Raise CardError unless ``card`` has nuScenes and forecasts of 6 s."""
    is_nuscenes = isinstance(card.source, NuScenesSource)
    if not is_nuscenes or card.task.future != OFFICIAL_STEPS:
        raise CardError(
            f"{card.id} has {card.task.future} steps of {card.source.name}, expected "
            f"{OFFICIAL_STEPS} of nuScenes, as MFEval and UniAD have"
        )
