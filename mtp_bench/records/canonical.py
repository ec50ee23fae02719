"""JSON that is the same for equal contents: what digests and signatures are of."""

from __future__ import annotations

import hashlib
import json
from typing import Any


def canonical(content: Any) -> bytes:
    """Sorted keys, no spaces, UTF-8. Raises ValueError for what JSON has not, such as NaN."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.encode()


def digest_of(content: Any) -> str:
    """Hex sha256 of the canonical JSON. Raises ValueError for what JSON has not."""
    return hashlib.sha256(canonical(content)).hexdigest()
