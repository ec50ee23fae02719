"""Cards: the source, task and sizes of an environment, as strict TOML."""

from .card import Card as Card
from .card import DetectorSection as DetectorSection
from .card import TaskSection as TaskSection
from .changes import changed_card as changed_card
from .changes import instead_of_stored as instead_of_stored
from .changes import load_card as load_card
from .changes import parse_card as parse_card
from .changes import with_detections as with_detections
from .changes import with_detector as with_detector
from .changes import with_files as with_files
from .changes import with_scenes as with_scenes
from .changes import with_split as with_split
from .source import FilesSource as FilesSource
from .source import SourceSection as SourceSection
