"""Wrappers of the env for agents of other libraries: an action that only associates, all at once or one by one."""

from .association import (
    AssociationOnly as AssociationOnly,
    PerDetection as PerDetection,
)
from .associator import CONTINUE as CONTINUE, IGNORE as IGNORE, NEW as NEW
