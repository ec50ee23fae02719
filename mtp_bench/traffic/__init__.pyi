from .drive_episode import DrivenEpisode as DrivenEpisode, whole_scene as whole_scene
from .drive_record import drive_rows as drive_rows
from .highway.source import unpack as unpack
from .highway.world import (
    RATE as RATE,
    SECRET_SEEDS as SECRET_SEEDS,
    HighwaySource as HighwaySource,
)
