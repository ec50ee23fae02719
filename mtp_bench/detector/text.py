"""A noise profile as the TOML text that `load_profile` reads."""

from __future__ import annotations

import json
import re
from typing import Any

from .profile import Profile

_COMMENTS = {
    "miss.first": "1, distance / 10 m, partly occluded, largely occluded, hidden, truncated",
    "miss.later": "the same, and: missed in the frame before",
    "size.mean": "length, width, height, m",
    "score.quadratic": "constant, per 10 m, per (10 m)^2",
}


def profile_text(profile: Profile) -> str:
    """TOML of a profile, every figure with all its digits: what is read back is equal."""
    content = profile.model_dump(exclude_none=True)
    classes, alike = content.pop("classes"), content.pop("alike")
    lines = _values(content, "")
    if alike:
        lines += ["", "[alike]", *_values(alike, "")]
    for name, noise in classes.items():
        lines += _table(f"classes.{_key(name)}", noise, "")
    return "\n".join(lines) + "\n"


def _table(heading: str, content: dict[str, Any], section: str) -> list[str]:
    """Lines of a table and of those in it."""
    inner = {key: value for key, value in content.items() if isinstance(value, dict)}
    own = {key: value for key, value in content.items() if key not in inner}
    lines = ["", f"[{heading}]", *_values(own, section)]
    for key, value in inner.items():
        lines += _table(f"{heading}.{key}", value, key)
    return lines


def _values(content: dict[str, Any], section: str) -> list[str]:
    comments = {key: _COMMENTS.get(f"{section}.{key}") for key in content}
    return [f"{_key(key)} = {_value(value)}" + (f"  # {comments[key]}" if comments[key] else "")
            for key, value in content.items()]  # fmt: skip


def _key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _value(value: str | bool | float | tuple[float, ...]) -> str:
    if isinstance(value, str | bool):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple):
        return f"[{', '.join(_value(one) for one in value)}]"
    return repr(float(value))
