"""Every option of every command: given twice, without a value, misspelt."""

from typing import Any

import pytest

from docs.generate.commands import _commands
from tests.support.command_line import CommandLine

COMMANDS = dict(_commands())
TAKES_SEVERAL = {
    "--agent", "--alike", "--also", "--detections", "--env", "--kind", "--min-score", "--tracks", "--with",
}  # fmt: skip  # in some commands


def options(command: Any) -> list[Any]:
    return [each for each in command.params if each.param_type_name == "option" and each.name != "help"]


def value(option: Any) -> list[str]:
    return [] if option.is_flag else ["1"]


@pytest.mark.parametrize("name", COMMANDS)
def test_wrong_uses_of_options_are_told(name: str, cli: CommandLine) -> None:
    """One error that names the option, of status 2, before any work."""
    command = COMMANDS[name]
    for option in options(command):
        word = option.opts[-1]
        given = [word, *value(option)]
        uses: dict[tuple[str, ...], str] = {(f"{word}=",): f"got an empty word at '{word}='"}
        uses[f"{word}x", *value(option)] = f"No such option: {word}x"
        if not option.multiple:
            uses[(*given, *given)] = "given twice, expected once"
        for words, message in uses.items():
            output = cli(*name.split(), *words)
            assert output.status == 2, (words, output)
            assert message in " ".join(output.err.split()), (words, output.err)
            assert "Traceback" not in output.err
            assert output.out == ""


def test_options_that_take_several_are_known() -> None:
    several = {option.opts[-1] for command in COMMANDS.values() for option in options(command) if option.multiple}
    assert several == TAKES_SEVERAL
