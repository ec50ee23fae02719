"""Agents in processes of their own, one frame at a time.

An agent's process gets detections frame by frame and sends answers; rewards, ``info`` and the truth stay with the
judge. A hash chain covers all answers, unchanged and in order. What an agent does ends at most its scene.

Who does what: `image` copies and hashes the submission, `layout` lists what the agent sees, `filter` the calls that it
may not make, `mechanism` chooses who shuts it in (bubblewrap, or `namespaces`), `launch` starts it or a `stem` of which
it is a fork (`stems` keeps these), `child` runs in it; `process` starts, watches and ends it, `channel` exchanges
messages (`wire`), `exchange` asks frame by frame. ``SECURITY.md`` says what holds,
and what does not. Where a system cannot isolate, agents run with limits only, and `SceneRun.isolation` says so.
"""

from .image import Image as Image
from .image import image_of as image_of
from .limits import PATIENCE as PATIENCE
from .limits import Isolation as Isolation
from .limits import Limits as Limits
from .limits import SceneRun as SceneRun
from .run import run_isolated as run_isolated
from .run import run_isolated_scenes as run_isolated_scenes
