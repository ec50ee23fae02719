"""Profile files: the shipped ones, and reading and writing profiles as TOML."""

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

from ..errors import CardError, require_known
from ..strict import read_toml, validate
from .profile import Profile

_STORE = Path(__file__).parent / "profiles"


@cache
def profile_names() -> tuple[str, ...]:
    """Names of the shipped profiles, sorted."""
    return tuple(sorted(path.stem for path in _STORE.glob("*.toml")))


def load_profile(name: str) -> Profile:
    """Load a shipped profile by name, or a profile from a TOML file; raises UnknownNameError or CardError."""
    return _read(Path(name)) if name.endswith(".toml") else _shipped(name)


def profile_for(detector: str) -> str:
    """Name of the shipped profile that can replace a stored detector, or an empty text."""
    if detector in profile_names():
        return detector
    return next((name for name in profile_names() if detector in _shipped(name).stands_for), "")


@cache
def _shipped(name: str) -> Profile:
    require_known("detector profile", name, profile_names())
    return _read(_STORE / f"{name}.toml")


def _read(path: Path) -> Profile:
    content = read_toml(path, CardError)
    if isinstance(content.get("detector"), dict):  # a section of a card, as fit-noise writes it
        content = content["detector"].get("noise")
        if not isinstance(content, dict):
            raise CardError(f"{path.name}: [detector] has no table 'noise', expected the parameters of a profile there")
    return validate(Profile, content, path.name, CardError)


def profile_text(profile: Profile) -> str:
    """TOML of a profile; numbers keep all digits, so that reading it gives an equal profile."""
    content = profile.model_dump(exclude_none=True)
    classes, alike = content.pop("classes"), content.pop("alike")
    if not content["stands_for"]:
        del content["stands_for"]
    lines = toml_values(content)
    if alike:
        lines += ["", "[alike]", *toml_values(alike)]
    for name, noise in classes.items():
        lines += toml_table(f"classes.{_key(name)}", noise)
    return "\n".join(lines) + "\n"


def toml_table(heading: str, content: dict[str, Any]) -> list[str]:
    """TOML lines of a table and its sub-tables; lists must be tuples."""
    tables = {key: value for key, value in content.items() if isinstance(value, dict)}
    values = {key: value for key, value in content.items() if key not in tables}
    lines = ["", f"[{heading}]", *toml_values(values)]
    for key, value in tables.items():
        lines += toml_table(f"{heading}.{key}", value)
    return lines


def toml_values(content: dict[str, Any]) -> list[str]:
    """TOML lines of values that are not tables."""
    return [f"{_key(key)} = {_value(value)}" for key, value in content.items()]


def _key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _value(value: str | bool | int | float | tuple[str | float, ...]) -> str:
    if isinstance(value, str | int):  # also true and false
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple):
        return f"[{', '.join(_value(item) for item in value)}]"
    return repr(float(value))
