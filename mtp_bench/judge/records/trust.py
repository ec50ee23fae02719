"""The trusted leaderboard: keys that may sign levels, seals, and owners of names.

Signatures are those of ``ssh-keygen -Y``.
"""

import hashlib
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ...agent import SubmissionName
from ...core import (
    MtpBenchError,
    RecordError,
    Section,
    __version__,
    bundled,
    files_digest,
    kept,
    read_toml,
    validate,
)
from .seal import (
    COMMITMENT,
    RETIRED,
    Commitment,
    ListedSeal,
    Retired,
    Sealed,
    commitment_of,
)
from .storage import read_as

OWNERS = "owners.toml"
NAMESPACE = "mtp-bench-level"  # signatures for another purpose do not count
SIGNER_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9@._-]{0,99}$"  # a principal without wildcards
MOST_SIGNATURE = 20_000  # characters
MISSING = (
    "ssh-keygen is not installed, so signatures can be neither made nor checked; "
    "install "
    "OpenSSH"
)
_CHECK_SECONDS = 30  # that ssh-keygen may take to check a signature
_MOST_OUTPUT = 200  # characters of a reason that ssh-keygen gives
# in lower case, options of keys that are not trusted for ever
_EXPIRING = ("valid-before", "cert-authority")


class _Owners(Section):
    # name -> login
    owners: dict[SubmissionName, Annotated[str, Field(pattern=r"^[A-Za-z0-9-]{1,39}$")]]


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
        """Public keys that no longer sign, one per line."""
        return self.folder / "keys" / "revoked_keys"

    @cached_property
    def state(self) -> str:
        """Text that changes with what signatures count; empty if a key expires.

        Raises OSError if a file cannot be read.
        """
        text = ""
        if self.keys.is_file():
            text = self.keys.read_text(encoding="utf-8", errors="replace").lower()
        if any(word in text for word in _EXPIRING):
            return ""
        # keys that count from a later day on
        starts = re.findall(r'valid-after="?(\d{8})', text)
        today = f"{date.today():%Y%m%d}"
        coming = [start for start in starts if start >= today]
        return f"{files_digest([self.keys, self.revoked])} {coming}"

    def check_once(self, check: Callable[[], None], *texts: str) -> None:
        """Call ``check`` of signed ``texts``, unless they passed before.

        It may raise. That they passed is kept, unless a key expires.
        """
        content = repr([__version__, self.state, *texts])
        digest = hashlib.sha256(content.encode()).hexdigest()
        kept(f"signed/{digest}", lambda: self.state and digest, check)

    @property
    def seals(self) -> Path:
        """Folder of the commitments, and of the secrets of retired seals."""
        return self.folder / "seals"

    @cached_property
    def listed(self) -> Mapping[str, ListedSeal]:
        """Seals by their commitment.

        Raises RecordError if a file is broken or does not fit its commitment.
        """
        seals = {}
        for path in sorted(self.seals.glob(f"*{COMMITMENT}")):
            commitment = read_as(Commitment, path)
            name = path.name.removesuffix(COMMITMENT)
            retired = _retired(path.with_name(name + RETIRED), commitment)
            seals[commitment.commitment] = ListedSeal(
                **commitment.model_dump(), name=name, retired=retired
            )
        return seals

    @cached_property
    def owners(self) -> Mapping[str, str]:
        """Login by the name of a submission.

        Raises RecordError if the file is broken.
        """
        return read_owners(self.folder / OWNERS)

    def require_listed(self, seals: Iterable[Sealed]) -> None:
        """Raise RecordError for a seal that this leaderboard does not list.

        Levels on it would not be shown.
        """
        for sealed in seals:
            if sealed.commitment not in self.listed:
                raise RecordError(
                    f"the seal of {sealed.seeds.env} with the sha256 "
                    f"{sealed.commitment[:12]} is not promised in {self.seals}, so no "
                    "level on it would be shown: publish its commitment there first"
                )

    def require_signer(self, key: Path, signer: str) -> None:
        """Raise MtpBenchError unless signatures of ``key`` for ``signer`` are trusted."""
        message = b"mtp-bench: may this key sign?"
        why = self.why_not_signed(message, sign(message, key), signer)
        if why:
            raise MtpBenchError(
                f"{key}: its signatures for {signer!r} are not trusted ({why}); list "
                "its "
                f"public part in {self.keys}"
            )

    def why_not_signed(self, message: bytes, signature: str, signer: str) -> str:
        """Return why this is not a signature by a trusted key of ``signer``.

        Empty if it is one of ``message``.
        """
        if not shutil.which("ssh-keygen"):
            return MISSING
        if not self.keys.is_file():
            return f"there are no keys at {self.keys}"
        with tempfile.NamedTemporaryFile(suffix=".sig") as signature_file:
            signature_file.write(signature.encode(errors="replace"))
            signature_file.flush()
            arguments = ["-Y", "verify", "-f", str(self.keys), "-I", signer]
            arguments += ["-n", NAMESPACE, "-s", signature_file.name]
            if self.revoked.is_file():
                arguments += ["-r", str(self.revoked)]
            _, why = _ssh_keygen(arguments, message, _CHECK_SECONDS)
            return why


def sign(message: bytes, key: Path) -> str:
    """Sign ``message`` by the key in the file ``key``.

    The file has a private key, or a public key whose private half an SSH agent has.
    Raises MtpBenchError if ssh-keygen is missing or refuses the key.
    """
    if not key.is_file():
        raise MtpBenchError(
            f"{key}: no such key; `ssh-keygen -t ed25519 -f {key}` makes one"
        )
    # without a limit of time: it may ask for a passphrase
    signature, why = _ssh_keygen(
        ["-Y", "sign", "-n", NAMESPACE, "-f", str(key)], message, None
    )
    if why:
        raise MtpBenchError(f"{key}: ssh-keygen did not sign: {why}")
    return signature


def read_owners(path: Path) -> dict[str, str]:
    """Read the login by the name of a submission.

    It is empty without a file. Raises RecordError if it is broken.
    """
    if not path.is_file():
        return {}
    return validate(
        _Owners, read_toml(path, RecordError), str(path), RecordError
    ).owners


def trusted(folder: Path | None = None) -> Trust:
    """Return the leaderboard at ``folder``.

    None: the one that ships. Raises RecordError if there is no such folder.
    """
    if folder is not None and not folder.is_dir():
        raise RecordError(
            f"{folder}: no such folder, expected a leaderboard with "
            "keys/allowed_signers "
            "and seals/"
        )
    return Trust(folder or bundled("leaderboard"))


def _retired(path: Path, commitment: Commitment) -> str:
    """Return the date on which the seal was retired.

    It is empty if it is in use. Raises RecordError if the published secret does not fit
    the commitment.
    """
    if not path.is_file():
        return ""
    published = read_as(Retired, path)
    if commitment_of(published.secret) != commitment.commitment:
        raise RecordError(
            f"{path}: its secret does not have the commitment "
            f"{commitment.commitment[:12]}"
        )
    return published.retired


def _ssh_keygen(
    arguments: Sequence[str], message: bytes, seconds: float | None
) -> tuple[str, str]:
    """Return the output of ssh-keygen on ``message`` and why it failed.

    The reason is empty if it did not.
    """
    command = ["ssh-keygen", *arguments]
    try:
        result = subprocess.run(
            command, input=message, capture_output=True, timeout=seconds, check=False
        )
    except FileNotFoundError:
        raise MtpBenchError(MISSING) from None
    except subprocess.TimeoutExpired:
        raise MtpBenchError(f"ssh-keygen took longer than {seconds} s") from None
    output = result.stdout.decode(errors="replace")
    if not result.returncode:
        return output, ""
    lines = f"{result.stderr.decode(errors='replace')}\n{output}"
    reason = " ".join(lines.split())[:_MOST_OUTPUT] or f"status {result.returncode}"
    return output, reason
