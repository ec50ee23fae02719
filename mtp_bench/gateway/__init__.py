"""Agents in processes of their own, one frame at a time.

An agent's process gets detections frame by frame and sends answers; rewards, ``info`` and the truth stay with the
judge. Every answer enters a hash chain before the next frame is sent. What an agent does ends at most its scene.

What is protected, on Linux where the system allows user namespaces (`SceneRun.isolation`):

- The judge's memory, environment, descriptors and working folder: the agent is in another user namespace.
- The data root and the cache of generated scenes: they are empty folders to the agent. All other files are read-only,
  but a temporary folder of bounded size.
- The network: there is none, and no service's socket under /run.
- Processes: the agent is the first one of its own process namespace, so all it started end with it.
- The cache of compiled kernels, which trusted processes load: the agent sees links to it and keeps what it adds.

Elsewhere the environment is still scrubbed, memory, file size and time are limited, and the judge's memory is closed to
its own user; but files of the user and the network are open, and any process of the user can be sent signals.

What is not protected: this is a process of the same user on the same machine, no virtual machine. An agent may read
other files of the user, hold whatever it was trained on, recognise a public scene, and generate simulated scenes anew,
for their seeds are public: for that there are other rigid motions and hidden seeds. It may use all cores of the machine
while it runs, and for a tenth of a second more memory than allowed, in several processes, until that is seen. A flaw of
the operating system's kernel opens everything.
"""

from .limits import PATIENCE as PATIENCE
from .limits import Isolation as Isolation
from .limits import Limits as Limits
from .limits import SceneRun as SceneRun
from .run import run_isolated as run_isolated
from .run import run_isolated_scenes as run_isolated_scenes
