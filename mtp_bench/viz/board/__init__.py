"""The leaderboard as a page that stands alone, as a table for the terminal and as JSON."""

from .entries import Entry as Entry
from .entries import Found as Found
from .entries import entries_of as entries_of
from .listing import board_json as board_json
from .listing import board_notes as board_notes
from .listing import board_tables as board_tables
from .page import board_page as board_page
