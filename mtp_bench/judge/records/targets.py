"""Targets of an environment by unit, which are the same for all agents.

The targets of an environment are stored once, in a file of ``leaderboard/targets``. A
record names its sha256, so that the file cannot be swapped. Where the leaderboard does
not have that file, the record brings the targets along in its own file.
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ...core import Floats, RecordError, Section, bundled, read_bounded, validate_json
from ...scoring import AgentTable, Subset, effective_number
from .canonical import digest_of, rounded
from .fields import Count, Name, NotNegative

MAX_SCENES = 10_000  # of a record
MAX_UNITS = 2_000  # of a record: blocks of 20 s
MAX_FILE_BYTES = 8 << 20
_FOLDER = "targets"  # of a leaderboard
_DIGITS_OF_NAME = 16  # of the sha256, in the name of a file
_COMPARED = ".6f"  # machines add in other orders


class SubsetTargets(Section):
    """Targets of one subset."""

    weight: Annotated[list[NotNegative], Field(max_length=MAX_UNITS)]  # [U]
    targets: Count
    effective_targets: NotNegative
    objects: Count
    effective_objects: NotNegative
    events: NotNegative | None  # expected number in a run of the reference tracker
    scenes: Count  # number of scenes that have these targets


class UnitTargets(Section):
    """Targets of all scenes of a record, by subset and unit."""

    # without names of hidden scenes, from which their seeds would follow
    scenes: Annotated[list[Name], Field(max_length=MAX_SCENES)]
    # number of units of each scene; the units of a scene are consecutive
    scene_units: Annotated[
        list[Annotated[int, Field(ge=1)]], Field(max_length=MAX_SCENES)
    ]
    nothing_predicted: NotNegative | None  # m, error if nothing is predicted
    subsets: dict[Subset, SubsetTargets]  # a closed loop has "all" alone

    @model_validator(mode="after")
    def _require_equal_lengths(self) -> Self:
        lengths = {len(part.weight) for part in self.subsets.values()} or {0}
        if self.scenes:
            lengths.add(sum(self.scene_units))
        if len(lengths) > 1 or len(self.scenes) != len(self.scene_units):
            raise ValueError("expected one weight per unit, of the units of all scenes")
        return self

    @cached_property
    def units(self) -> int:
        """Number of units U."""
        return len(self.subsets["all"].weight) if "all" in self.subsets else 0

    @cached_property
    def digest(self) -> str:
        """Hex sha256 of the canonical JSON, which is the content of the file."""
        return digest_of(self.model_dump(mode="json"))

    @cached_property
    def conditions(self) -> str:
        """Digest that is equal for targets that differ by rounding alone.

        Older records do not have the subset "turning".
        """
        content = self.model_dump(mode="json")
        content["subsets"].pop("turning", None)
        return digest_of(rounded(content, _COMPARED))

    def on(self, subset: Subset) -> SubsetTargets:
        """Return the targets of a subset.

        They are without weight if it has none.
        """
        return self.subsets.get(subset) or SubsetTargets(
            weight=[0.0] * self.units,
            targets=0,
            effective_targets=0.0,
            objects=0,
            effective_objects=0.0,
            events=None,
            scenes=0,
        )

    def scene_sums(self, unit_values: Sequence[float]) -> Floats:
        """Return the sums [S] over the units of each scene of ``unit_values`` [U]."""
        first_units = np.cumsum([0, *self.scene_units[:-1]])
        return np.add.reduceat(np.asarray(unit_values, dtype=np.float64), first_units)


NO_TARGETS = UnitTargets(scenes=[], scene_units=[], nothing_predicted=None, subsets={})
_by_digest: dict[str, UnitTargets] = {}  # targets that were read and checked


def targets_of(
    table: AgentTable, subsets: Sequence[Subset], nothing_predicted: float | None
) -> UnitTargets:
    """Return the targets of the table of one agent."""
    scores = table.setting.seeds[0]
    return UnitTargets(
        scenes=[score.scene for score in scores],
        scene_units=[score.units for score in scores],
        nothing_predicted=rounded(nothing_predicted),
        subsets={subset: _subset_targets(table, subset) for subset in subsets},
    )


def drive_targets(scenes: Sequence[str]) -> UnitTargets:
    """Return the targets of a closed loop, one drive per scene."""
    count = len(scenes)
    drives = SubsetTargets(
        weight=[1.0] * count,
        targets=count,
        effective_targets=float(count),
        objects=count,
        effective_objects=float(count),
        events=None,
        scenes=count,
    )
    return UnitTargets(
        scenes=list(scenes),
        scene_units=[1] * count,
        nothing_predicted=None,
        subsets={"all": drives},
    )


def targets_path(leaderboard: Path, env_id: str, targets_sha256: str) -> Path:
    """Return the path of a file of targets in the folder of a leaderboard."""
    return leaderboard / _FOLDER / f"{env_id}.{targets_sha256[:_DIGITS_OF_NAME]}.json"


def ships(env_id: str, targets_sha256: str) -> bool:
    """Return True if the leaderboard of this installation has these targets."""
    return targets_path(bundled("leaderboard"), env_id, targets_sha256).is_file()


def read_targets(record_file: Path, env_id: str, targets_sha256: str) -> UnitTargets:
    """Read the targets that the record at ``record_file`` names.

    They are in the leaderboard that holds the record, else in that of this
    installation. Raises RecordError if they are missing, malformed or others.
    """
    if targets_sha256 in _by_digest:
        return _by_digest[targets_sha256]
    # its leaderboard holds records/<submission>/<env id>.json
    folders = [*record_file.absolute().parents[2:3], bundled("leaderboard")]
    files = [targets_path(folder, env_id, targets_sha256) for folder in folders]
    targets_file = next((path for path in files if path.is_file()), None)
    if targets_file is None:
        raise RecordError(
            f"{record_file}: its targets have the sha256 "
            f"{targets_sha256[:_DIGITS_OF_NAME]}, and there "
            f"is no file {files[0]}: keep the record in a leaderboard that has it"
        )
    text = read_bounded(targets_file, MAX_FILE_BYTES, RecordError)
    where = str(targets_file)
    targets = validate_json(UnitTargets, text, where, RecordError)
    return require_digest(targets, targets_sha256, where)


def require_digest(
    targets: UnitTargets, targets_sha256: str, where: str
) -> UnitTargets:
    """Return ``targets``.

    Raises RecordError unless they have the digest.
    """
    if targets.digest != targets_sha256:
        raise RecordError(
            f"{where}: these targets have the sha256 {targets.digest[:12]}, the record "
            f"names {targets_sha256[:12]}: they were changed"
        )
    return _by_digest.setdefault(targets_sha256, targets)


def _subset_targets(table: AgentTable, subset: Subset) -> SubsetTargets:
    weight = table.weight[subset]
    sums = table.sums_on(subset)
    weighted = weight > 0
    return SubsetTargets(
        weight=rounded(sums.weight.tolist()),
        targets=int(weighted.sum()),
        effective_targets=rounded(effective_number(weight)),
        objects=len(np.unique(table.person[weighted])),
        effective_objects=rounded(sums.effective_objects),
        events=rounded(table.events[subset]),
        scenes=len(np.unique(table.scene[weighted])),
    )
