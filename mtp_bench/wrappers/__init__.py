"""Wrappers of the env for agents of other libraries: an action that only associates, all at once or one by one."""

from .association import AssociationOnly as AssociationOnly
from .association import PerDetection as PerDetection
from .associator import CONTINUE as CONTINUE
from .associator import IGNORE as IGNORE
from .associator import NEW as NEW
