from .board.columns import board_json as board_json, board_table as board_table
from .board.entries import (
    Entry as Entry,
    LinkedRecord as LinkedRecord,
    entries_of as entries_of,
    env_order as env_order,
)
from .board.page import (
    BoardFiles as BoardFiles,
    Pages as Pages,
    board_files as board_files,
    parts_folder as parts_folder,
    require_parts as require_parts,
    write_board as write_board,
)
from .board.tables import board_tables as board_tables
from .causes import sentence as sentence
from .drawing.report import save_report as save_report
from .drawing.video import (
    VIDEO_SUFFIXES as VIDEO_SUFFIXES,
    pictures as pictures,
    require_encoder as require_encoder,
    write_video as write_video,
)
from .focus import Focus as Focus
from .framing import focuses_of as focuses_of, frames_around as frames_around
from .incident import INCIDENT_KINDS as INCIDENT_KINDS
from .moment_list import (
    AT as AT,
    costs as costs,
    find_incident as find_incident,
    moments as moments,
)
from .played import PlayedRun as PlayedRun, replays as replays
from .rerun.recording import save_recording as save_recording
from .rerun.viewer import (
    require_display as require_display,
    show_recording as show_recording,
)
from .run_moments import worst_moments as worst_moments
from .run_replay import Replay as Replay, replay as replay
from .studies.curves import draw_curves as draw_curves
from .studies.doubts import doubt_page as doubt_page
from .studies.figures import FILE_SUFFIXES as FILE_SUFFIXES
from .studies.meeting import meeting_page as meeting_page
from .studies.study import (
    Study as Study,
    require_study_folder as require_study_folder,
    study as study,
)
from .terminal.event_table import (
    EVENT_CAPTION as EVENT_CAPTION,
    LOOK as LOOK,
    ORDERS as ORDERS,
    Listed as Listed,
    Tally as Tally,
    event_table as event_table,
    events_json as events_json,
    in_order as in_order,
    longest_only as longest_only,
    show_collisions as show_collisions,
    tally_line as tally_line,
)
from .terminal.listings import (
    data_lines as data_lines,
    env_table as env_table,
    status_json as status_json,
    status_table as status_table,
)
from .terminal.notes import notes as notes, warnings as warnings
from .terminal.output import (
    command_line as command_line,
    counted as counted,
    show as show,
    show_command as show_command,
    show_lines as show_lines,
    show_table as show_table,
)
from .terminal.tables import (
    data_table as data_table,
    full_tables as full_tables,
    paired_table as paired_table,
)
from .terminal.verdict import cost_lines as cost_lines, verdict as verdict
from .terminal.worst_table import (
    CAPTION_BELOW as CAPTION_BELOW,
    UNSPLIT as UNSPLIT,
    WORST_CAPTION as WORST_CAPTION,
    WorstRow as WorstRow,
    run_line as run_line,
    worst_json as worst_json,
    worst_table as worst_table,
)
