"""The profile of model 2 of a real detector, fitted to its detections."""

from .profile import fit_profile as fit_profile
