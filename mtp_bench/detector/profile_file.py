"""Profile files: the shipped ones, harder ones and those without memory, reading and writing profiles as TOML."""

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..core import CardError, Section, read_toml, require_known, validate
from .profile import ClassNoise, Profile, Variant

_STORE = Path(__file__).parent / "profiles"
WORSE = 2.0  # factor on position errors and on false positives
LOWER = 0.6  # decrease of the quality of all objects; adds about 1 to the log-odds of being undetected
_NO_MEMORY = {"bias": 0.0, "ar": 0.0, "white": 1.0, "phi": 0.0}


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
    return next(
        (name for name in profile_names() if detector in _shipped(name).stands_for), ""
    )


@cache
def _shipped(name: str) -> Profile:
    require_known("detector profile", name, profile_names())
    return _read(_STORE / f"{name}.toml")


def _read(path: Path) -> Profile:
    content = read_toml(path, CardError)
    if isinstance(
        content.get("detector"), dict
    ):  # a section of a card, as fit-noise writes it
        content = content["detector"].get("noise")
        if not isinstance(content, dict):
            raise CardError(
                f"{path.name}: [detector] has no table 'noise', expected the parameters of a profile there"
            )
    return validate(Profile, content, path.name, CardError)


def with_variant(profile: Profile, variant: Variant) -> Profile:
    """``profile`` itself, or a variant named "<name>-iid" or "<name>-hard".

    "iid": the same recall and error distributions without memory; "hard": lower quality, twice the position errors and
    false positives.
    """
    if variant == "as_fitted":
        return profile
    changes = _without_memory if variant == "iid" else _harder
    classes = {
        name: noise.model_copy(update=changes(noise))
        for name, noise in profile.classes.items()
    }
    return profile.model_copy(
        update={"name": f"{profile.name}-{variant}", "classes": classes}
    )


def _without_memory(noise: ClassNoise) -> dict[str, Any]:
    heading = noise.heading
    from .draws import stationary  # SciPy takes long to import

    flips = float(stationary(np.asarray(heading.flip), np.asarray(heading.flip_again)))
    unshared = {**_NO_MEMORY, "shared": 0.0}
    lapses = _with(noise.quality.lapses, {"bias": 0.0, "phi": 0.0, "shared": 0.0})
    return {
        "heading": _with(heading, {"flip": flips, "flip_again": flips}),
        "size": _with(noise.size, {"white": 1.0}),
        "quality": _with(noise.quality, {**unshared, "lapses": lapses}),
        "radial": _with(noise.radial, unshared),
        "tangential": _with(noise.tangential, unshared),
        "free": _with(noise.free, {**_NO_MEMORY, "survive": 0.0}),
        "near": _with(noise.near, _NO_MEMORY),
    }


def _harder(noise: ClassNoise) -> dict[str, Any]:
    location, free, near = noise.quality.location, noise.free, noise.near
    # the relative difference between scenes stays
    dispersion = 1.0 if free is None else 1.0 + WORSE * (free.dispersion - 1.0)
    return {
        "radial": _with(
            noise.radial, {"s0": WORSE * noise.radial.s0, "s1": WORSE * noise.radial.s1}
        ),
        "tangential": _with(
            noise.tangential,
            {"s0": WORSE * noise.tangential.s0, "s1": WORSE * noise.tangential.s1},
        ),
        "quality": _with(
            noise.quality, {"location": (location[0] - LOWER, *location[1:])}
        ),
        "free": _with(
            free,
            {}
            if free is None
            else {"rate": WORSE * free.rate, "dispersion": dispersion},
        ),
        "near": _with(
            near, {} if near is None else {"chance": min(WORSE * near.chance, 1.0)}
        ),
    }


def _with(part: Section | None, changes: dict[str, Any]) -> Section | None:
    """A part of a noise with other parameters; None stays None."""
    return None if part is None else part.model_copy(update=changes)


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
    return (
        name
        if re.fullmatch("[A-Za-z0-9_-]+", name)
        else json.dumps(name, ensure_ascii=False)
    )


def _value(value: str | bool | int | float | tuple[str | float, ...]) -> str:
    if isinstance(value, str | int):  # also true and false
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple):
        return f"[{', '.join(_value(item) for item in value)}]"
    return repr(float(value))
