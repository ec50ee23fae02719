"""Completion of words in a shell."""

import pytest

from tests.support.command_line import CommandLine


class Shell:
    """Completion as bash asks for it."""

    def __init__(self, cli: CommandLine, patch: pytest.MonkeyPatch) -> None:
        self._cli, self._patch = cli, patch
        patch.setenv("_MTP_BENCH_COMPLETE", "complete_bash")

    def __call__(self, words: str) -> list[str]:
        line = f"mtp-bench {words}"
        self._patch.setenv("COMP_WORDS", line)
        self._patch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
        return self._cli.ok().split()


@pytest.fixture
def offered(cli: CommandLine, monkeypatch: pytest.MonkeyPatch) -> Shell:
    return Shell(cli, monkeypatch)


def test_commands_and_options(offered: Shell) -> None:
    assert (offered("ver"), sorted(offered("run --sc"))) == (["verify"], ["--scenes", "--scheduler"])
