"""The commands of ``mtp-bench``: `mtp_bench.cli` puts them together.

Their options are in ``running``, ``looking``, ``fitting`` and ``submitting``; what takes more than a few lines to do
and to print is in the other modules.
"""
