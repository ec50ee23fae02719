from .card import (
    Card as Card,
    DetectorSection as DetectorSection,
    DriveSection as DriveSection,
    LaneSection as LaneSection,
    PerturbSection as PerturbSection,
    PlannerSection as PlannerSection,
    TaskSection as TaskSection,
)
from .changes import (
    CardChanges as CardChanges,
    ChangeKeywords as ChangeKeywords,
    as_recorded as as_recorded,
    instead_of_stored as instead_of_stored,
    load_card as load_card,
    parse_card as parse_card,
    with_classes as with_classes,
    with_detections as with_detections,
    with_detector as with_detector,
    with_files as with_files,
    with_perturb as with_perturb,
    with_presence as with_presence,
    with_scenes as with_scenes,
    with_split as with_split,
)
from .own import (
    own_digest as own_digest,
    path_digest as path_digest,
    split_folder as split_folder,
)
from .source import (
    SOURCES as SOURCES,
    STORED_DETECTOR as STORED_DETECTOR,
    DetectionsSection as DetectionsSection,
    FilesSource as FilesSource,
    SourceSection as SourceSection,
    Traits as Traits,
)
