"""The commands of ``mtp-bench``, one file each; `mtp_bench.commands.app` puts them together."""
