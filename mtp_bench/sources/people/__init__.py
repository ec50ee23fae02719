"""ETH/UCY: people on the ground plane in eight recordings, read into scenes."""

from ..base import SourcePackage
from .source import DATASET, People, PeopleSource as PeopleSource, files_of

PACKAGE = SourcePackage(
    open=People,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, files_of(card)[0]),
)
