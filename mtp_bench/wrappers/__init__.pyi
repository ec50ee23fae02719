from .association import (
    AssociationOnly as AssociationOnly,
    PerDetection as PerDetection,
)
from .associator import CONTINUE as CONTINUE, IGNORE as IGNORE, NEW as NEW
