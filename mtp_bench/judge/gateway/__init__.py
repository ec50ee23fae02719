"""Agents in processes of their own, one frame at a time.

An agent's process gets detections and sends answers; rewards, ``info`` and the truth
stay with the judge. A hash chain covers all answers in their order. What an agent does
ends at most its scene.

`layout` copies the submission and lists the files that an agent sees, `sandbox` runs
bubblewrap with them and a filter of system calls. A `fork_server` per submission makes
the agent processes (`fork_server_main` and `child` run inside the sandbox). `process`
starts, watches and ends one, `channel` exchanges messages (`wire`), `exchange` asks
frame by frame. ``SECURITY.md`` says which attacks the sandbox stops. Without one there
are limits alone (`SceneRun.isolation`).
"""
