"""The commands of ``mtp-bench``, one file each; `mtp_bench.commands.app` puts them together."""


def main() -> None:
    """Entry point of the command line."""
    from .app import main as run

    run()
