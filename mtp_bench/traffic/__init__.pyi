from .drive.episode import DrivenEpisode as DrivenEpisode
from .drive.scenes import whole_scene as whole_scene
from .highway.store import unpack as unpack
from .highway.world import (
    RATE as RATE,
    SECRET_SEEDS as SECRET_SEEDS,
    HighwaySource as HighwaySource,
)
