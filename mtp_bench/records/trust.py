"""Whom a leaderboard trusts: keys that may sign levels, seals that were promised, and whose a name is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

from pydantic import Field

from .._bundle import bundled
from ..errors import RecordError
from ..strict import Section, read_toml, validate
from .promise import RETIRED, Commitment, Retired, commitment_of
from .storage import read_as

_PROMISE = ".commitment.json"


class ListedSeal(Commitment):
    """A seal of the leaderboard: what was promised, and whether its secret was published."""

    name: str
    retired: str  # date; empty: it may still be used


class _Owners(Section):
    owners: dict[str, Annotated[str, Field(pattern=r"^[A-Za-z0-9-]{1,39}$")]]  # name of a submission -> login


@dataclass(frozen=True)
class Trust:
    """The folder ``leaderboard`` whose word counts."""

    folder: Path

    @property
    def keys(self) -> Path:
        """Keys that may sign, in OpenSSH's own format."""
        return self.folder / "keys" / "allowed_signers"

    @property
    def revoked(self) -> Path:
        """Keys that may not any more, one public key per line, if there are any."""
        return self.folder / "keys" / "revoked_keys"

    @property
    def seals(self) -> Path:
        """Commitments, and the secrets of seals that were retired."""
        return self.folder / "seals"

    @cached_property
    def listed(self) -> Mapping[str, ListedSeal]:
        """The seals by their commitment. Raises RecordError where a file is broken or does not fit its promise."""
        found = {}
        for path in sorted(self.seals.glob(f"*{_PROMISE}")):
            promise = read_as(Commitment, path)
            name = path.name.removesuffix(_PROMISE)
            retired = _retired(path.with_name(name + RETIRED), promise)
            found[promise.commitment] = ListedSeal(**promise.model_dump(), name=name, retired=retired)
        return found

    @cached_property
    def owners(self) -> Mapping[str, str]:
        """Login by the name of a submission. Raises RecordError where the file is broken."""
        return read_owners(self.folder / "owners.toml")


def read_owners(path: Path) -> dict[str, str]:
    """Login by the name of a submission; none where there is no file. Raises RecordError where it is broken."""
    if not path.is_file():
        return {}
    return validate(_Owners, read_toml(path, RecordError), str(path), RecordError).owners


def trusted(folder: Path | None = None) -> Trust:
    """The leaderboard at ``folder``; None: the one that ships. Raises RecordError where there is no such folder."""
    if folder is not None and not folder.is_dir():
        raise RecordError(f"{folder}: no such folder, expected a leaderboard with keys/allowed_signers and seals/")
    return Trust(folder or bundled("leaderboard"))


def _retired(path: Path, promise: Commitment) -> str:
    """When the seal was retired; RecordError where what was published is not what was promised."""
    if not path.is_file():
        return ""
    published = read_as(Retired, path)
    if commitment_of(published.secret) != promise.commitment:
        raise RecordError(f"{path}: its secret is not the one that {promise.commitment[:12]} promised")
    return published.retired
