"""A simulated detector: noise profiles fitted to real detectors, and the detections they give for true boxes."""

from .profile import Profile as Profile, Variant as Variant
from .profile_file import load_profile as load_profile, profile_names as profile_names
