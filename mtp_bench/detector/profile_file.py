"""Profile files: shipped ones and their variants, and own ones as TOML."""

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..core import CardError, Section, read_toml, require_known, validate
from .profile import ClassNoise, Profile, Variant

_FOLDER = Path(__file__).parent / "profiles"
_NO_MEMORY = {"bias": 0.0, "ar": 0.0, "white": 1.0, "phi": 0.0}


@cache
def profile_names() -> tuple[str, ...]:
    """Return the names of the shipped profiles, sorted."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))


def load_profile(name: str) -> Profile:
    """Load a shipped profile, or one from a TOML file.

    ``name`` is a file if it ends in ".toml". Raises UnknownNameError if no profile of
    that name ships, CardError for a wrong file.
    """
    return _read(Path(name)) if name.endswith(".toml") else _shipped(name)


def profile_for(detector: str) -> str:
    """Return the shipped profile that replaces a stored detector.

    Empty if no profile replaces it.
    """
    if detector in profile_names():
        return detector
    for name in profile_names():
        if detector in _shipped(name).stands_for:
            return name
    return ""


@cache
def _shipped(name: str) -> Profile:
    require_known("detector profile", name, profile_names())
    return _read(_FOLDER / f"{name}.toml")


def _read(path: Path) -> Profile:
    content: Any = read_toml(path, CardError)
    section = content.get("detector")
    if isinstance(section, dict):  # a section of a card, as fit-noise writes it
        content = section.get("noise")
        if not isinstance(content, dict):
            raise CardError(
                f"{path.name}: [detector] has no table 'noise',"
                " expected the parameters of a profile there"
            )
    return validate(Profile, content, path.name, CardError)


def with_variant(profile: Profile, variant: Variant) -> Profile:
    """Return a variant of ``profile``.

    "as_fitted": the profile itself; "iid": "<name>-iid", with the same recall and error
    distributions without memory.
    """
    if variant == "as_fitted":
        return profile
    classes = {
        name: noise.model_copy(update=_without_memory(noise))
        for name, noise in profile.classes.items()
    }
    name = f"{profile.name}-{variant}"
    return profile.model_copy(update={"name": name, "classes": classes})


def _without_memory(noise: ClassNoise) -> dict[str, Any]:
    """Return the parts of a noise that lose their memory."""
    from .draws import stationary  # SciPy takes long to import

    heading = noise.heading
    flips = float(stationary(np.asarray(heading.flip), np.asarray(heading.flip_again)))
    unshared = {**_NO_MEMORY, "shared": 0.0}
    lapses = _with(noise.quality.lapses, bias=0.0, phi=0.0, shared=0.0)
    return {
        "heading": _with(heading, flip=flips, flip_again=flips),
        "size": _with(noise.size, white=1.0),
        "quality": _with(noise.quality, **unshared, lapses=lapses),
        "radial": _with(noise.radial, **unshared),
        "tangential": _with(noise.tangential, **unshared),
        "free": _with(noise.free, **_NO_MEMORY, survive=0.0),
        "near": _with(noise.near, **_NO_MEMORY),
    }


def _with(part: Section | None, **changes: Any) -> Section | None:
    """Return a part of a noise with other parameters.

    None stays None.
    """
    return None if part is None else part.model_copy(update=changes)


def profile_text(profile: Profile) -> str:
    """Return the TOML of a profile.

    Numbers keep all digits, so that reading it gives an equal profile.
    """
    content = profile.model_dump(exclude_none=True)
    classes = content.pop("classes")
    classes_alike = content.pop("alike")
    if not content["stands_for"]:
        del content["stands_for"]
    lines = toml_values(content)
    if classes_alike:
        lines += toml_table("alike", classes_alike)
    for name, noise in classes.items():
        lines += toml_table(f"classes.{_key(name)}", noise)
    return "\n".join(lines) + "\n"


def toml_table(heading: str, content: dict[str, Any]) -> list[str]:
    """Return TOML lines of a table and its sub-tables."""
    tables = {key: value for key, value in content.items() if isinstance(value, dict)}
    values = {key: value for key, value in content.items() if key not in tables}
    lines = ["", f"[{heading}]", *toml_values(values)]
    for key, value in tables.items():
        lines += toml_table(f"{heading}.{key}", value)
    return lines


def toml_values(content: dict[str, Any]) -> list[str]:
    """Return TOML lines of values that are not tables."""
    return [
        f"{_key(key)} = {json.dumps(value, ensure_ascii=False)}"
        for key, value in content.items()
    ]


def _key(name: str) -> str:
    """Return a key of TOML, in quotes if it needs them."""
    if re.fullmatch("[A-Za-z0-9_-]+", name):
        return name
    return json.dumps(name, ensure_ascii=False)
