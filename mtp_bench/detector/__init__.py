"""A simulated detector: noise profiles fitted to real ones, and what they make of true boxes."""

from .model2.profile import Profile2 as Profile2
from .profile import Profile as Profile
from .profile import Variant as Variant
from .profile import load_profile as load_profile
from .profile import profile_names as profile_names
