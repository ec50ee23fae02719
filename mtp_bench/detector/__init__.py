"""A simulated detector: noise profiles fitted to real ones, and what they make of true boxes."""

from .model1.profile import Profile1 as Profile1
from .model2.profile import Profile as Profile
from .profile import load_profile as load_profile
from .profile import profile_names as profile_names
from .sections import Variant as Variant
