"""The study: what tracking errors cost prediction on an env, where, how often, and what hypotheses win back.

`plan` says what is run, `runs` runs it or reads it back, `findings` scores it; `tables` are what is measured, `figures`
what is drawn of it, `relations` what the paper says beside it, and `page` tells the story.
"""

from __future__ import annotations

from .conduct import Study as Study
from .conduct import study as study
