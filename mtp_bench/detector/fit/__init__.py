"""The noise profile of a real detector, fitted to its detections."""

from .detector import fit_profile as fit_profile
