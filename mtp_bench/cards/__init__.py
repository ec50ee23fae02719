"""Cards: what an environment replays, its task and its sizes, as strict TOML."""

from .card import Card as Card
from .card import TaskSection as TaskSection
from .card import card_text as card_text
from .card import changed_card as changed_card
from .card import load_card as load_card
from .card import parse_card as parse_card
from .changes import VARIANTS as VARIANTS
from .changes import instead_of_stored as instead_of_stored
from .changes import profile_of_stored as profile_of_stored
from .sections import DetectorSection as DetectorSection
from .sections import FilesSource as FilesSource
from .source import SourceSection as SourceSection
