"""The noise profile of a real detector, fitted to its detections, and figures of how well a detector does."""

from .detector import fit_profile as fit_profile
from .statistics import detector_statistics as detector_statistics
