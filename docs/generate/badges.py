"""Draw the badges of the README: what they say is read from the package.

    python -m docs.generate.badges        # docs/badges/*.svg

They are files of the repository, so that no page asks another server. A test draws them again and compares.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from mtp_bench import __version__
from mtp_bench.scoring import DEFINITIONS

from .svg import text

FOLDER = Path(__file__).resolve().parents[1] / "badges"
_PYTHON = "Programming Language :: Python :: 3."
_GROUND, _VALUE = "#444444", "#0072b2"
_LETTER, _MARGIN, _HEIGHT = 7.2, 14.0, 22.0  # px


def badges() -> dict[str, str]:
    """The file of each badge by its name."""
    project = tomllib.loads((FOLDER.parents[1] / "pyproject.toml").read_text())[
        "project"
    ]
    minor = sorted(
        int(line.removeprefix(_PYTHON))
        for line in project["classifiers"]
        if line.startswith(_PYTHON)
    )
    said = {
        "version": __version__,
        "definitions": DEFINITIONS,
        "python": f"3.{minor[0]} to 3.{minor[-1]}",
        "licence": project["license"],
    }
    return {name: badge(name, value) for name, value in said.items()}


def badge(name: str, value: str) -> str:
    """A name on dark ground, and its value beside it."""
    left, right = (len(words) * _LETTER + _MARGIN for words in (name, value))
    size = f'width="{left + right:.0f}" height="{_HEIGHT:.0f}"'
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" font-family="sans-serif" font-size="12">',
            f"<title>{name}: {value}</title>",
            f'<rect width="{left:.0f}" height="{_HEIGHT:.0f}" fill="{_GROUND}"/>',
            f'<rect x="{left:.0f}" width="{right:.0f}" height="{_HEIGHT:.0f}" fill="{_VALUE}"/>',
            text((left / 2, 15), name, "white", "middle"),
            text((left + right / 2, 15), value, "white", "middle"),
            "</svg>\n",
        ]
    )


def main() -> None:
    """Write all of them."""
    FOLDER.mkdir(exist_ok=True)
    for name, drawn in badges().items():
        (FOLDER / f"{name}.svg").write_text(drawn)


if __name__ == "__main__":
    main()
