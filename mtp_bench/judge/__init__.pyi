from .gateway.layout import Image as Image, image_of as image_of
from .gateway.limits import (
    Isolation as Isolation,
    Limits as Limits,
    SceneRun as SceneRun,
)
from .gateway.run import (
    run_isolated as run_isolated,
    run_isolated_scenes as run_isolated_scenes,
)
from .records.attestation import (
    Checked as Checked,
    SignedLevel as SignedLevel,
    read_level as read_level,
)
from .records.canonical import (
    Difference as Difference,
    digest_of as digest_of,
    rounded as rounded,
)
from .records.checking import (
    MAX_CHECKED_SCENES as MAX_CHECKED_SCENES,
    check_submission as check_submission,
)
from .records.consistency import checked_record as checked_record
from .records.eligibility import (
    LEAST_HIDDEN as LEAST_HIDDEN,
    is_baseline as is_baseline,
    why_scored_otherwise as why_scored_otherwise,
    why_unranked as why_unranked,
)
from .records.fields import LEVELS as LEVELS, Level as Level
from .records.file_entries import (
    FileEntry as FileEntry,
    read_file_entries as read_file_entries,
)
from .records.intake import take_in as take_in
from .records.inventory import (
    RecordPiece as RecordPiece,
    inventory as inventory,
    standing_record as standing_record,
    why_impossible as why_impossible,
)
from .records.ranking import STP as STP, Standing as Standing, standings as standings
from .records.record import HiddenPart as HiddenPart, Record as Record
from .records.rounds import (
    attest as attest,
    level_reached as level_reached,
    submission_of as submission_of,
)
from .records.seal import (
    COMMITMENT as COMMITMENT,
    SEALS as SEALS,
    Sealed as Sealed,
    open_seal as open_seal,
    open_seals as open_seals,
    retire as retire,
    seal as seal,
    seal_path as seal_path,
)
from .records.storage import load_record as load_record, record_paths as record_paths
from .records.submitting import (
    RECORDS as RECORDS,
    record_path as record_path,
    require_target as require_target,
    submit as submit,
)
from .records.trust import Trust as Trust, trusted as trusted
from .records.verifying import Verification as Verification, verify as verify
