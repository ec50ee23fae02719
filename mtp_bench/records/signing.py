"""SSH signatures by keys that the leaderboard lists (``ssh-keygen -Y sign`` and ``-Y verify``)."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ..errors import MtpBenchError
from .trust import Trust

NAMESPACE = "mtp-bench-level"  # signatures for another purpose do not count
SIGNER_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9@._-]{0,99}$"  # a principal without wildcards
MOST_SIGNATURE = 20_000  # characters
MISSING = "ssh-keygen is not installed, so signatures can be neither made nor checked; install OpenSSH"
_SECONDS = 30
_MOST_OUTPUT = 200  # characters
_PROGRAM = "ssh-keygen"


def sign(message: bytes, key: Path) -> str:
    """Signature of ``message`` by the key in the file ``key``: a private key, or a public one that an SSH agent serves.

    Raises MtpBenchError if ssh-keygen is missing or refuses the key.
    """
    if not key.is_file():
        raise MtpBenchError(f"{key}: no such key; `ssh-keygen -t ed25519 -f {key}` makes one")
    done = _run(["-Y", "sign", "-n", NAMESPACE, "-f", str(key)], message, seconds=None)  # it may ask for a passphrase
    if done.returncode:
        raise MtpBenchError(f"{key}: ssh-keygen did not sign: {_output(done)}")
    return done.stdout.decode("ascii", errors="replace")


def why_not_signed(message: bytes, signature: str, signer: str, trust: Trust) -> str:
    """Reason why this is not a signature of ``message`` by a trusted key of ``signer``; empty if it is."""
    if not shutil.which(_PROGRAM):
        return MISSING
    if not trust.keys.is_file():
        return f"there are no keys at {trust.keys}"
    revoked = ["-r", str(trust.revoked)] if trust.revoked.is_file() else []
    with tempfile.NamedTemporaryFile(suffix=".sig") as file:
        file.write(signature.encode(errors="replace"))
        file.flush()
        which = ["-f", str(trust.keys), "-I", signer, "-n", NAMESPACE, "-s", file.name, *revoked]
        done = _run(["-Y", "verify", *which], message, _SECONDS)
    return _output(done) if done.returncode else ""


def require_signer(key: Path, signer: str, trust: Trust) -> None:
    """Raise MtpBenchError unless signatures of ``key`` for ``signer`` are trusted."""
    message = b"mtp-bench: may this key sign?"
    why = why_not_signed(message, sign(message, key), signer, trust)
    if why:
        raise MtpBenchError(
            f"{key}: its signatures for {signer!r} are not trusted ({why}); list its public part in {trust.keys}"
        )


def _run(arguments: Sequence[str], message: bytes, seconds: float | None) -> subprocess.CompletedProcess[bytes]:
    try:
        return subprocess.run([_PROGRAM, *arguments], input=message, capture_output=True, timeout=seconds, check=False)
    except FileNotFoundError:
        raise MtpBenchError(MISSING) from None
    except subprocess.TimeoutExpired:
        raise MtpBenchError(f"ssh-keygen took longer than {seconds} s") from None


def _output(done: subprocess.CompletedProcess[bytes]) -> str:
    """Output of ssh-keygen in one line."""
    output = (done.stderr + b"\n" + done.stdout).decode(errors="replace")
    return " ".join(output.split())[:_MOST_OUTPUT] or f"status {done.returncode}"
