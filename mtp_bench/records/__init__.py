"""Leaderboard records: results of a submission, how they were measured, and their verification.

A record is a JSON file with a digest of its own, which shows careless changes and is not a signature. A forged record
is found when its stored rollouts are scored again (`verify`), and when its submission is run again. The level that was
reached is signed, and stands in the same file.
"""

from .attestation import read_level as read_level
from .consistency import checked_record as checked_record
from .eligibility import why_unranked as why_unranked
from .ranking import standings as standings
from .record import Record as Record
from .seal import open_seal as open_seal, retire as retire, seal as seal
from .storage import load_record as load_record, record_paths as record_paths
from .submitting import submit as submit
from .trust import Trust as Trust, trusted as trusted
from .verifying import verify as verify
