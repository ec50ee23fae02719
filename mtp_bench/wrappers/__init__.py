"""A wrapper of the env for agents of other libraries: an action that only associates."""

from .association import CONTINUE as CONTINUE
from .association import IGNORE as IGNORE
from .association import NEW as NEW
from .association import AssociationOnly as AssociationOnly
