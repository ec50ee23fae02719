"""Pages of results: Markdown whose figures come from the records of the leaderboard, and whose claims they bear out."""

from .fill import fill as fill
from .known import Known as Known
from .known import known_of as known_of
