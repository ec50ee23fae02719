"""Records on recorded scenes that are better than prediction from ground-truth tracks: held back from ranks.

A table of the public scenes could make such a record. A maintainer who has looked at it states so in a signed level.
"""

from collections.abc import Sequence

from ..scoring.definitions import SUBSETS, Subset
from ..scoring.rank import why_not_on
from ..scoring.statistics import PairedDifference, paired_difference
from .attestation import Checked

HELD_BACK = "better than ground truth: not ranked until looked at"


def is_held_back(one: Checked, truths: Sequence[Checked]) -> bool:
    """True if a record is significantly better than each of ``truths``, all on one subset that ranks.

    ``truths``: prediction from ground-truth tracks on the same units, with motion models and with the best network. A
    record on hidden scenes, or that was looked at, is never held back.
    """
    looked_at = one.signed is not None and one.signed.statement.looked_at
    if one.on_hidden or looked_at or not truths:
        return False
    objects = {subset: one.sums.row_of(subset).effective_objects for subset in SUBSETS}
    ranked = (each for each in SUBSETS if why_not_on(each, objects[each], one.sums.unit_weight(each)) is None)
    return any(all(_is_better(one, truth, subset) for truth in truths) for subset in ranked)


def difference_of(one: Checked, other: Checked, subset: Subset) -> PairedDifference | None:
    """BADE of ``one`` minus that of ``other``, metres, paired by unit; both have the same targets and units."""
    return paired_difference(one.sums.unit_error(subset), other.sums.unit_error(subset), one.sums.unit_weight(subset))


def _is_better(one: Checked, truth: Checked, subset: Subset) -> bool:
    difference = difference_of(one, truth, subset)
    return difference is not None and difference.mean < 0 and difference.significant
