"""Leaderboard records: what a submission scored, how it was measured, and how anyone checks it.

A record is a JSON file with a digest of its own. The digest tells of accidents and of careless changes; it is no
signature. What cannot be forged without being found is a record whose stored rollouts are scored again (`verify`), and
a submission that is run again. Who did that signs the level that was reached, in a file beside the record.
"""

from .attestation import SignedLevel as SignedLevel
from .attestation import read_level as read_level
from .eligibility import why_unranked as why_unranked
from .history import OldResult as OldResult
from .history import read_history as read_history
from .ranking import Standing as Standing
from .ranking import standings as standings
from .record import Record as Record
from .seal import open_seal as open_seal
from .seal import retire as retire
from .seal import seal as seal
from .storage import load_record as load_record
from .storage import record_paths as record_paths
from .storage import save_record as save_record
from .submitting import submit as submit
from .trust import Trust as Trust
from .trust import trusted as trusted
from .verifying import Verification as Verification
from .verifying import verify as verify
