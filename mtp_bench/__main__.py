"""``python -m mtp_bench`` is ``mtp-bench``, but imports modules of the current folder; see ``SECURITY.md``."""

from importlib.metadata import entry_points

(_command,) = entry_points(group="console_scripts", name="mtp-bench")
_command.load()()
