"""The leaderboard as a page that needs no server, as a table for the terminal, as JSON and CSV."""

from .entries import Entry as Entry
from .entries import Found as Found
from .entries import entries_of as entries_of
from .listing import board_tables as board_tables
from .page import BoardFiles as BoardFiles
from .page import board_files as board_files
from .tables import board_json as board_json
from .writing import parts_folder as parts_folder
from .writing import require_parts as require_parts
from .writing import write_board as write_board
