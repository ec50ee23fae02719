"""The version of the package.

Read by the build, by ``mtp_bench.__version__`` and by stored records.
"""

__version__ = "0.3.0"
