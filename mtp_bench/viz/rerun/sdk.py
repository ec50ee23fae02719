"""rerun in the version that the drawings are made for; the only file that imports it.

Importing this module takes about a second: only commands that draw import it, inside
their functions.
"""

import rerun as rr
import rerun.blueprint as rrb

INSTALL = 'pip install "rerun-sdk>=0.41,<0.42"'

__all__ = ["INSTALL", "rr", "rrb"]
