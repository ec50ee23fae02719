"""Training: windows of tracklets beside the truth, and what is fitted to them."""

from .tracklets import Windows as Windows
from .tracklets import windows as windows
