"""Noise of a detector: fitted parameters per class, as stored in TOML.

The model and its symbols are described in ``mtp_bench/detector/README.md``. Distances d are in units of 10 m from the
sensor; ``z`` is a latent standard normal number with a share that stays with the object, a share that follows a
first-order autoregression over frames, and a white share.
"""

from __future__ import annotations

import itertools
import json
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from ..errors import CardError, UnknownNameError
from ..strict import Section, read_toml, validate

if TYPE_CHECKING:
    from .model2.profile import Profile2

Variant = Literal["as_fitted", "iid", "hard"]
Share = Annotated[float, Field(ge=0, le=1)]
Scale = Annotated[float, Field(ge=0)]
Correlation = Annotated[float, Field(gt=-1, lt=1)]

SIMILAR = {"bicycle": "motorcycle", "construction_vehicle": "truck"}  # for profiles that do not know a class

_EVENLY = tuple(round(2.0 + 5.8 * tenth, 1) for tenth in range(11))  # from 2 m to 60 m
_STORE = Path(__file__).parent / "profiles"
_COMMENTS = {
    "miss.first": "1, distance / 10 m, partly occluded, largely occluded, hidden, truncated",
    "miss.later": "the same, and: undetected in the frame before",
    "size.mean": "length, width, height, m",
    "score.quadratic": "constant, per 10 m, per (10 m)^2",
}


class Memory(Section):
    """How a latent number is correlated over the frames of an object; the three shares of its variance sum to 1."""

    bias: Share  # constant over the object's life
    ar: Share  # autoregressive
    phi: Correlation  # of the autoregression, from frame to frame
    white: Share

    @field_validator("white")
    @classmethod
    def _shares_are_complete(cls, white: float, info: ValidationInfo) -> float:
        total = white + info.data.get("bias", 0.0) + info.data.get("ar", 0.0)
        if {"bias", "ar"} <= set(info.data) and abs(total - 1.0) > 0.01:
            raise ValueError(f"bias + ar + white is {total:.4g}, expected 1")
        return white


class UndetectedNoise(Section):
    """Log-odds that an object is undetected."""

    first: Annotated[tuple[float, ...], Field(min_length=6, max_length=6, strict=False)]
    # of an object's first frame: 1, d, partly occluded, largely occluded, hidden, truncated
    later: Annotated[tuple[float, ...], Field(min_length=7, max_length=7, strict=False)]
    # the same, and: undetected in the frame before
    memory: bool = True  # False: every later frame is drawn with the long-run chance of that chain


class PositionNoise(Memory):
    """Position error along one axis: ``(s0 + s1 d) T_nu^-1(Phi(z))``, metres."""

    s0: Scale  # m
    s1: Scale  # m per 10 m
    nu: Annotated[float, Field(gt=1)]  # degrees of freedom of Student's t


class HeadingNoise(Section):
    """Heading error: Student's t with 4 degrees of freedom, and turns by pi as a two-state Markov chain."""

    scale: Scale  # rad, robust standard deviation (1.4826 x median absolute deviation) of the unflipped error
    flip: Share  # chance of a flip after a frame without
    flip_again: Share  # chance of a flip after a flip


class SizeNoise(Section):
    """Error of length, width, height: normal, constant over the object's life up to ``white``."""

    mean: Annotated[tuple[float, float, float], Field(strict=False)]  # m
    deviation: Annotated[tuple[float, float, float], Field(strict=False)]  # m
    white: Share = 0.1  # share of the variance that changes from frame to frame


class ScoreNoise(Memory):
    """Score of a detection: a normal number around ``quadratic(d)`` that ends at ``floor`` and ``ceiling``."""

    quadratic: Annotated[tuple[float, float, float], Field(strict=False)]  # constant, per d, per d^2
    deviation: Scale
    floor: float  # the operating point: the detector's output ends here
    ceiling: float | None = None  # e.g. 1 for probabilities

    @field_validator("ceiling")
    @classmethod
    def _is_above_the_floor(cls, ceiling: float | None, info: ValidationInfo) -> float | None:
        floor = info.data.get("floor")
        if ceiling is not None and floor is not None and ceiling <= floor:
            raise ValueError(f"expected more than the floor, {floor:g}")
        return ceiling


class FalsePositives(Section):
    """False positives: births are Poisson, with a rate that is Gamma distributed over scenes; survival is geometric."""

    rate: Scale  # false positives per frame over the profile's whole field of view
    dispersion: Annotated[float, Field(ge=1)]  # variance over mean of the count per frame
    survive: Annotated[float, Field(ge=0, lt=1)]  # chance that one is there in the next frame too
    score: float  # location and deviation of a normal number that ends at the detector's floor and ceiling
    score_deviation: Scale
    size: Annotated[tuple[float, float, float], Field(strict=False)]  # m, mean length, width, height
    distance: Annotated[tuple[Scale, ...], Field(min_length=11, max_length=11, strict=False)] = _EVENLY
    # m from the sensor: quantiles at 0, 10, ..., 100 %

    @field_validator("distance")
    @classmethod
    def _ascends(cls, distance: tuple[float, ...]) -> tuple[float, ...]:
        if any(far < near for near, far in itertools.pairwise(distance)):
            raise ValueError("expected ascending distances")
        return distance


class ClassNoise(Section):
    """All noise of one class."""

    miss: UndetectedNoise
    radial: PositionNoise
    tangential: PositionNoise
    heading: HeadingNoise
    size: SizeNoise
    score: ScoreNoise
    false_positives: FalsePositives | None = None
    velocity: Scale | None = None  # m/s per axis; None: velocities are not measured
    z: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)  # m, height of the centre: mean, deviation
    duplicates: Share = 0.0  # chance that a detection comes twice


class Profile(Section):
    """A detector by model 1: noise per class at one frame period."""

    model: ClassVar[int] = 1  # turns a profile into detections; part of every card's digest
    name: str
    summary: str
    source: str  # where the figures come from
    dt: Annotated[float, Field(gt=0)]  # s between frames at which the memory was fitted
    field_of_view: Annotated[float, Field(gt=0, le=360)] = 360.0  # degrees in which the false positives were counted
    classes: dict[str, ClassNoise]
    # Further classes and the class whose noise they have.
    alike: dict[str, str] = Field(default_factory=dict)

    @field_validator("alike")
    @classmethod
    def _have_noise(cls, alike: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        known: dict[str, ClassNoise] = info.data.get("classes", {})
        for own in alike.values():
            if known and own not in known:
                raise ValueError(f"{own!r} has no noise; expected one of {', '.join(map(repr, known))}")
        return alike

    def noise(self, class_name: str) -> ClassNoise:
        """Noise of a class, or of a similar one; raises UnknownNameError for what the profile does not know."""
        own = self.alike.get(class_name, class_name)
        if own not in self.classes and class_name in SIMILAR:
            return self.noise(SIMILAR[class_name])
        if own not in self.classes:
            known = [*self.classes, *self.alike]
            raise UnknownNameError(f"class of detector profile {self.name!r}", class_name, known)
        return self.classes[own]


def profile_names(model: Literal[1, 2] = 2) -> list[str]:
    """Names of the profiles of a model that ship; those of model 1 begin with "v1/"."""
    folder = "" if model == 2 else "v1/"
    return sorted(folder + path.stem for path in (_STORE / folder).glob("*.toml"))


def load_profile(name: str) -> Profile | Profile2:
    """A shipped profile by name, or one from a TOML file; raises UnknownNameError or CardError.

    A file with ``model = 2`` is of that model, one without the key of model 1.
    """
    return _read(Path(name)) if name.endswith(".toml") else _shipped(name)


@cache
def _shipped(name: str) -> Profile | Profile2:
    """Read and checked once: a card asks for its profile many times."""
    if name not in (known := [*profile_names(), *profile_names(1)]):
        raise UnknownNameError("detector profile", name, known)
    return _read(_STORE / f"{name}.toml")


def _read(path: Path) -> Profile | Profile2:
    content = read_toml(path, CardError)
    if isinstance(content.get("detector"), dict):  # a section of a card, as fit-noise writes it
        if not isinstance(content["detector"].get("noise"), dict):
            raise CardError(f"{path.name}: its [detector] has no [detector.noise], expected the figures of a profile")
        content = content["detector"]["noise"]
    if "model" not in content:
        return validate(Profile, content, path.name, CardError)
    from .model2.profile import Profile2

    return validate(Profile2, content, path.name, CardError)


def profile_text(profile: Profile | Profile2) -> str:
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


def _value(value: str | bool | int | float | tuple[float, ...]) -> str:
    if isinstance(value, str | int):  # also true and false
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple):
        return f"[{', '.join(_value(one) for one in value)}]"
    return repr(float(value))
