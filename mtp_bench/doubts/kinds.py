"""Doubts: signs above their limits, in words."""

from functools import cache
from typing import Any

import numpy as np
from pydantic import Field

from ..core import MtpBenchError, Section, toml_beside, validate
from .form_signs import unit_of
from .maps import UNITS
from .recording import NEVER, RecordedScene
from .signs import Sign

DOCTOR_VERSION = 9  # results of another one are made anew
_MARGIN = 1.05  # of a limit above the largest healthy value


class Kind(Section):
    """Meaning of a sign above its limit."""

    part: str  # of the stack: truth, detections, ego, clock, map
    unit: str  # of the size
    name: str  # as a runner-up: "a delay"
    says: str  # sentence with the fields of `_fields`
    below: str = ""  # the sentence for a size below 0
    other: str = ""  # what it may be as well, if no other kind comes near
    cure: str  # what to do
    least: float  # value that is worth telling
    # kinds that follow from it in the same scene
    explains: list[str] = Field(default_factory=list)


class Doubt(Section):
    """A reason to doubt the data of a scene."""

    scene: str
    kind: str
    part: str
    size: float
    unit: str
    value: float  # of the sign
    limit: float  # that the value is above
    before: float | None  # misfit in [0, 1]; None without a fit
    after: float | None  # misfit when undone
    runner_up: str  # what explains nearly as much, in words; empty: nothing
    first: int  # first frame that it touches; -1: all
    last: int
    objects: tuple[int, ...]  # ids; empty: all
    text: str
    cure: str

    @property
    def line(self) -> str:
        """The doubt as one sentence, and its cure."""
        sentence = self.text
        if self.before is not None:
            sentence += f": misfit {self.before:.2f} -> {self.after:.2f} when undone"
        if self.runner_up:
            sentence += f" (or: {self.runner_up})"
        if not sentence.endswith("?"):
            sentence += "."
        return f"{sentence} Cure: {self.cure}"


@cache
def kinds() -> dict[str, Kind]:
    """Return all kinds by name, in the order of their file."""
    return {
        name: validate(Kind, table, name, MtpBenchError)
        for name, table in toml_beside(__file__, "kinds.toml").items()
    }


@cache
def limit_of(kind: str) -> float:
    """Return the value above which a sign is a doubt.

    It is worth telling, and clearly above that of any healthy recording.
    """
    healthy = float(toml_beside(__file__, "healthy.toml").get(kind, 0.0))
    return max(kinds()[kind].least, _MARGIN * healthy)


def is_doubt(sign: Sign) -> bool:
    """Return True for a sign above the limit of its kind."""
    return sign.value > limit_of(sign.kind)


def doubt_of(sign: Sign, recording: RecordedScene, runner_up: str = "") -> Doubt:
    """Return the doubt that a sign above its limit is.

    ``runner_up``: kind that explains nearly as much.
    """
    kind = kinds()[sign.kind]
    fields = _fields(sign, recording)
    is_below = bool(kind.below) and sign.stated_size < 0
    says = kind.below if is_below else kind.says
    other = kinds()[runner_up].name if runner_up else kind.other
    ids = (sign.object_id, sign.other_id)
    return Doubt(
        scene=recording.scene.name,
        kind=sign.kind,
        part=kind.part,
        size=float(sign.stated_size),
        unit=kind.unit,
        value=float(sign.value),
        limit=limit_of(sign.kind),
        before=_known(sign.before),
        after=_known(sign.after),
        runner_up=other.format(**fields),
        first=sign.first,
        last=sign.last,
        objects=tuple(number for number in ids if number != NEVER),
        text=says.format(**fields),
        cure=kind.cure.format(**fields),
    )


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _fields(sign: Sign, recording: RecordedScene) -> dict[str, Any]:
    """Return what sentences name."""
    size = sign.stated_size
    ahead, left = (*sign.values, 0.0, 0.0)[:2]
    unit_name, unit_factor = unit_of(abs(size) + 1e-9)
    return {
        "size": abs(size),
        "seconds": abs(size) * recording.period,
        "shift": -size,
        "ahead": ahead,
        "left": left,
        "sign": sign,
        "times": UNITS.get(sign.variant, 1.0),
        "unit_name": unit_name,
        "unit_factor": unit_factor,
        "object": recording.object_name(sign.object_id),
        "other": recording.object_name(sign.other_id),
    }
