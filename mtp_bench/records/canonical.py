"""JSON that is the same for equal contents: what digests and signatures are of; how they and dates are written."""

from __future__ import annotations

import datetime
import hashlib
import json
from typing import Annotated, Any

from pydantic import Field

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Date = Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]


def canonical(content: Any) -> bytes:
    """Sorted keys, no spaces, UTF-8. Raises ValueError for what JSON has not, such as NaN."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.encode()


def digest_of(content: Any) -> str:
    """Hex sha256 of the canonical JSON. Raises ValueError for what JSON has not."""
    return hashlib.sha256(canonical(content)).hexdigest()


def today() -> str:
    """The date, UTC."""
    return datetime.datetime.now(datetime.UTC).date().isoformat()
