"""The leaderboard as a page that needs no server, as tables of the terminal and as files."""

from .columns import board_json as board_json
from .columns import data_table as data_table
from .entries import Entry as Entry
from .entries import Found as Found
from .entries import entries_of as entries_of
from .entries import is_baseline as is_baseline
from .page import BoardFiles as BoardFiles
from .page import Pages as Pages
from .page import board_files as board_files
from .page import parts_folder as parts_folder
from .page import require_parts as require_parts
from .page import write_board as write_board
from .tables import board_tables as board_tables
from .tables import style_of as style_of
