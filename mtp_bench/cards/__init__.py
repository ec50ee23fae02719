"""Cards: the source, task and sizes of an environment, as strict TOML."""

from .card import (
    Card as Card,
    DetectorSection as DetectorSection,
    TaskSection as TaskSection,
)
from .changes import (
    CHANGES as CHANGES,
    changed_card as changed_card,
    instead_of_stored as instead_of_stored,
    load_card as load_card,
    parse_card as parse_card,
    with_detections as with_detections,
    with_detector as with_detector,
    with_files as with_files,
    with_presence as with_presence,
    with_scenes as with_scenes,
    with_split as with_split,
)
from .source import FilesSource as FilesSource, SourceSection as SourceSection
