"""rerun in the version that the drawings are made for; the only file that imports it.

Importing this module takes about a second: only commands that draw import it, inside
their functions.
"""

from ...core import MtpBenchError

VERSION = "0.41"
INSTALL = f'pip install "rerun-sdk>={VERSION},<0.42"'

try:
    import rerun as rr
    import rerun.blueprint as rrb
except ImportError as error:
    raise MtpBenchError(
        f"rerun cannot be imported ({error}), which draws recordings: {INSTALL}"
    ) from None

if not str(getattr(rr, "__version__", "")).startswith(f"{VERSION}."):
    version = getattr(rr, "__version__", "of unknown version")
    raise MtpBenchError(f"rerun is {version}, expected {VERSION}: {INSTALL}")

__all__ = ["rr", "rrb"]
