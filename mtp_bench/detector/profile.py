"""Profiles of detectors: those that ship, and their text in TOML."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any, Literal

from ..errors import CardError, UnknownNameError
from ..strict import read_toml, validate
from .model1.profile import Profile1
from .model2.profile import Profile

_STORE = Path(__file__).parent / "profiles"
_COMMENTS = {
    "miss.first": "1, distance / 10 m, partly occluded, largely occluded, hidden, truncated",
    "miss.later": "the same, and: undetected in the frame before",
    "size.mean": "length, width, height, m",
    "score.quadratic": "constant, per 10 m, per (10 m)^2",
}


def profile_names(model: Literal[1, 2] = 2) -> list[str]:
    """Names of the profiles of a model that ship; those of model 1 begin with "v1/"."""
    folder = "" if model == 2 else "v1/"
    return sorted(folder + path.stem for path in (_STORE / folder).glob("*.toml"))


def load_profile(name: str) -> Profile | Profile1:
    """A shipped profile by name, or one from a TOML file; raises UnknownNameError or CardError.

    A file with ``model = 2`` is of that model, one without the key of model 1.
    """
    return _read(Path(name)) if name.endswith(".toml") else _shipped(name)


@cache
def _shipped(name: str) -> Profile | Profile1:
    """Read and checked once: a card asks for its profile many times."""
    if name not in (known := [*profile_names(), *profile_names(1)]):
        raise UnknownNameError("detector profile", name, known)
    return _read(_STORE / f"{name}.toml")


def _read(path: Path) -> Profile | Profile1:
    content = read_toml(path, CardError)
    if isinstance(content.get("detector"), dict):  # a section of a card, as fit-noise writes it
        if not isinstance(content["detector"].get("noise"), dict):
            raise CardError(f"{path.name}: its [detector] has no [detector.noise], expected the figures of a profile")
        content = content["detector"]["noise"]
    if "model" in content:
        return validate(Profile, content, path.name, CardError)
    return validate(Profile1, content, path.name, CardError)


def profile_text(profile: Profile | Profile1) -> str:
    """TOML of a profile, every figure with all its digits: what is read back is equal."""
    content = profile.model_dump(exclude_none=True)
    classes, alike = content.pop("classes"), content.pop("alike")
    lines = toml_values(content)
    if alike:
        lines += ["", "[alike]", *toml_values(alike)]
    for name, noise in classes.items():
        lines += toml_table(f"classes.{_key(name)}", noise)
    return "\n".join(lines) + "\n"


def toml_table(heading: str, content: dict[str, Any], section: str = "") -> list[str]:
    """Lines of TOML of a table and of those in it; lists are tuples."""
    inner = {key: value for key, value in content.items() if isinstance(value, dict)}
    own = {key: value for key, value in content.items() if key not in inner}
    lines = ["", f"[{heading}]", *toml_values(own, section)]
    for key, value in inner.items():
        lines += toml_table(f"{heading}.{key}", value, key)
    return lines


def toml_values(content: dict[str, Any], section: str = "") -> list[str]:
    """Lines of TOML of what is no table, with what the figures of a profile mean."""
    comments = {key: _COMMENTS.get(f"{section}.{key}") for key in content}
    return [f"{_key(key)} = {_value(value)}" + (f"  # {comments[key]}" if comments[key] else "")
            for key, value in content.items()]  # fmt: skip


def _key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _value(value: str | bool | int | float | tuple[str | float, ...]) -> str:
    if isinstance(value, str | int):  # also true and false
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple):
        return f"[{', '.join(_value(one) for one in value)}]"
    return repr(float(value))
