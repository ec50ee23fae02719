"""``python -m mtp_bench`` is ``mtp-bench``."""

from .commands import main

main()
