"""``python -m mtp_bench`` is ``mtp-bench``, but imports modules of the current folder; see ``SECURITY.md``."""

from .commands.app import main

main()
