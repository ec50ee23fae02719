"""Commands of ``mtp-bench``, one file each."""
