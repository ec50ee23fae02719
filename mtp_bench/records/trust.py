"""The trusted leaderboard: keys that may sign levels, listed seals, and owners of names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

from pydantic import Field

from .._bundle import bundled
from ..errors import RecordError
from ..strict import Section, read_toml, validate
from .seal import COMMITMENT, RETIRED, Commitment, ListedSeal, Retired, Sealed, commitment_of
from .storage import read_as

OWNERS = "owners.toml"


class _Owners(Section):
    owners: dict[str, Annotated[str, Field(pattern=r"^[A-Za-z0-9-]{1,39}$")]]  # name of a submission -> login


@dataclass(frozen=True)
class Trust:
    """The folder ``leaderboard`` that is trusted."""

    folder: Path

    @property
    def keys(self) -> Path:
        """Keys that may sign, in OpenSSH's own format."""
        return self.folder / "keys" / "allowed_signers"

    @property
    def revoked(self) -> Path:
        """Revoked keys, one public key per line; the file may be missing."""
        return self.folder / "keys" / "revoked_keys"

    @property
    def seals(self) -> Path:
        """Folder of the commitments, and of the secrets of retired seals."""
        return self.folder / "seals"

    @cached_property
    def listed(self) -> Mapping[str, ListedSeal]:
        """The seals by their commitment. Raises RecordError if a file is broken or does not fit its commitment."""
        seals = {}
        for path in sorted(self.seals.glob(f"*{COMMITMENT}")):
            promise = read_as(Commitment, path)
            name = path.name.removesuffix(COMMITMENT)
            retired = _retired(path.with_name(name + RETIRED), promise)
            seals[promise.commitment] = ListedSeal(**promise.model_dump(), name=name, retired=retired)
        return seals

    @cached_property
    def owners(self) -> Mapping[str, str]:
        """Login by the name of a submission. Raises RecordError if the file is broken."""
        return read_owners(self.folder / OWNERS)

    def require_listed(self, seals: Iterable[Sealed]) -> None:
        """Raise RecordError for a seal that this leaderboard does not list: levels on it would not be shown."""
        for sealed in seals:
            if sealed.commitment not in self.listed:
                raise RecordError(
                    f"the seal of {sealed.seeds.env} with the sha256 {sealed.commitment[:12]} is not promised in "
                    f"{self.seals}, so no level on it would be shown: publish its commitment there first"
                )


def read_owners(path: Path) -> dict[str, str]:
    """Login by the name of a submission; empty without a file. Raises RecordError if it is broken."""
    if not path.is_file():
        return {}
    return validate(_Owners, read_toml(path, RecordError), str(path), RecordError).owners


def trusted(folder: Path | None = None) -> Trust:
    """The leaderboard at ``folder``; None: the one that ships. Raises RecordError if there is no such folder."""
    if folder is not None and not folder.is_dir():
        raise RecordError(f"{folder}: no such folder, expected a leaderboard with keys/allowed_signers and seals/")
    return Trust(folder or bundled("leaderboard"))


def _retired(path: Path, promise: Commitment) -> str:
    """Date on which the seal was retired; RecordError if the published secret does not fit the commitment."""
    if not path.is_file():
        return ""
    published = read_as(Retired, path)
    if commitment_of(published.secret) != promise.commitment:
        raise RecordError(f"{path}: its secret does not have the commitment {promise.commitment[:12]}")
    return published.retired
