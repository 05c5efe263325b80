"""One self-contained HTML page of pictures and of claims that are met or not.

Sections --html--> text; pictures inside as data, no reference to anything outside
"""

from __future__ import annotations

import base64
import importlib.resources
from collections.abc import Sequence

import jinja2
import msgspec

TEMPLATE = "page.html"


class Claim(msgspec.Struct, frozen=True):
    """What was said of a figure, and what came of it here."""

    figure: str
    claim: str
    ours: str
    met: bool


class Picture(msgspec.Struct, frozen=True):
    """A PNG and what it shows."""

    name: str
    caption: str
    png: bytes

    @property
    def source(self) -> str:
        """The picture as an address that holds it."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode()


class Section(msgspec.Struct, frozen=True):
    """One figure of the paper."""

    name: str
    title: str
    pictures: tuple[Picture, ...]
    claims: tuple[Claim, ...]
    commands: tuple[str, ...]  # that make the runs again, one by one


class Page(msgspec.Struct, frozen=True):
    """All that the page says."""

    title: str
    facts: tuple[str, ...]
    problems: tuple[str, ...]
    sections: tuple[Section, ...]


def html(page: Page) -> str:
    """Text of the page; what comes from names and texts is escaped."""
    return render(TEMPLATE, page=page, claims=_claims(page.sections))


def render(template: str, **values: object) -> str:
    """A template of this package, filled in; texts are escaped, and nothing may be missing."""
    folder = importlib.resources.files(__package__)
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: folder.joinpath(name).read_text("utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)


def _claims(sections: Sequence[Section]) -> list[Claim]:
    return [claim for section in sections for claim in section.claims]
