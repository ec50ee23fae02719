"""Order of the parts of an error, by the stages that cause them."""

from collections import defaultdict
from collections.abc import Mapping

from ..scoring import BELOW_THRESHOLD, LEAST_SHOWN, STAGE_PARTS

_STAGES = {name: stage for stage, names in STAGE_PARTS.items() for name in names}
DETECTION_REASONS = ("no forecast", "other class", "off place")  # reasons


def ranked_parts(
    parts: Mapping[str, float], is_borrowed: bool
) -> list[tuple[str, str, float]]:
    """Rank the parts of an error, the gravest first.

    Returns stage, reason and cost in m. The stage with the largest sum comes first,
    below threshold last. Stages and parts that do not add to the error are left out.
    ``is_borrowed``: the detections behind it are of other objects, so the object itself
    is not detected.
    """
    stages = dict(_STAGES)
    if is_borrowed:
        stages |= dict.fromkeys(DETECTION_REASONS, "detector")
    totals_m: dict[str, float] = defaultdict(float)
    for name, cost_m in parts.items():
        totals_m[stages[name]] += cost_m

    def sort_key(name: str) -> tuple[bool, float, float]:
        return name == BELOW_THRESHOLD, -totals_m[stages[name]], -parts[name]

    return [
        (stages[name], name, parts[name])
        for name in sorted(parts, key=sort_key)
        if parts[name] > 0 and totals_m[stages[name]] >= LEAST_SHOWN
    ]
