"""Traffic simulated on highway-env's roads, one scene per seed."""

from ..base import SourcePackage
from .source import DATASET, HighwayTraffic, generate, highway_status

PACKAGE = SourcePackage(
    open=HighwayTraffic,
    dataset=DATASET,
    locate=highway_status,
    prepare=generate,
    discard=lambda card: HighwayTraffic(card).discard(),
    keep_private=lambda card: HighwayTraffic(card).store.keep_private(),
)
