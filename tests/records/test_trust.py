"""Passed checks of signatures are kept, unless a key expires or another user could have written them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from mtp_bench.core.files import CACHE_VARIABLE
from mtp_bench.judge.records.trust import Trust

CASES: dict[str, tuple[str, Callable[[Path], object], int]] = {
    "as it was written": ("", lambda kept: None, 1),
    "a file that others may write": ("", lambda kept: kept.chmod(0o666), 2),
    "a folder that others may write": ("", lambda kept: kept.parent.chmod(0o777), 2),
    "a link": ("", lambda kept: kept.symlink_to(kept.rename(kept.with_name("other"))), 2),
    "a key that expires": ('Valid-Before="20991231" ', lambda kept: None, 2),
}


@pytest.mark.parametrize("case", CASES)
def test_a_passed_check_is_kept(case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options, change, times = CASES[case]
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    trust, calls = Trust(tmp_path), list[int]()
    trust.keys.parent.mkdir()
    trust.keys.write_text(f"tester {options}ssh-ed25519 AAAA\n", encoding="utf-8")
    trust.check_once(lambda: calls.append(1), "text")
    for kept in (tmp_path / "cache").glob("signed/*"):
        change(kept)
    trust.check_once(lambda: calls.append(1), "text")
    assert len(calls) == times
