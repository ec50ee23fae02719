"""Driving logs in the Arrow form of 123D (py123d 0.7), written as tables of own scenes.

Not read, since they know what comes next: the column ``velocity_3d`` (a difference to
the next frame) and the file ``route_position`` (the way that the ego will drive). Boxes
that py123d interpolates between keyframes are refused.
"""

from .logs import import_logs as import_logs
