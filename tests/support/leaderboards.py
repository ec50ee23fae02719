"""Leaderboards of their own, with keys that are made for a test."""

import subprocess
from pathlib import Path

SIGNER = "tester"


def make_key(path: Path) -> Path:
    """A new private key at ``path``; its public part goes beside it."""
    made = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "of a test", "-f", str(path)]
    subprocess.run(made, check=True, capture_output=True)
    return path


def listed(key: Path, signer: str = SIGNER, options: str = "") -> str:
    """The line of ``allowed_signers`` for a key."""
    kind, public, *_ = key.with_name(f"{key.name}.pub").read_text().split()
    return " ".join(filter(None, (signer, options, kind, public))) + "\n"


def make_leaderboard(folder: Path, *lines: str) -> Path:
    """A folder ``leaderboard`` with folders of records and seals, and these lines of ``allowed_signers``."""
    for name in ("keys", "records", "seals"):
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / ".gitkeep").touch()  # git has no empty folders
    (folder / "keys" / "allowed_signers").write_text("".join(lines))
    (folder / "owners.toml").write_text("[owners]\n")
    return folder
