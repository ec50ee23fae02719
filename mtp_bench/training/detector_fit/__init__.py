"""Fit of a noise profile to the detections of a real detector."""

from .profile import fit_profile as fit_profile
