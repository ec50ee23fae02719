"""Training: windows of tracklets with their true futures, and the models that are fitted to them."""

from .tracklets import Windows as Windows, windows as windows
