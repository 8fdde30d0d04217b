"""The examples as pages of the site, from their READMEs."""

from __future__ import annotations

import re
from pathlib import Path

FOLDER = "examples"
"""Folder of the examples in the repository, and of their pages below the docs."""
_REPOSITORY = Path(__file__).parents[4]
_DOCS = "../../dextera_build/docs/"
_SCHEME = re.compile(r"[a-z]+:|#")


def pages() -> dict[str, str]:
    """Name of an example -> its page; none in an installed copy, which has no examples."""
    found = sorted((_REPOSITORY / FOLDER).glob("*/README.md"))
    return {file.parent.name: moved(file.read_text(encoding="utf-8")) for file in found}


def moved(text: str) -> str:
    """A README with its links as they are from its page.

    Raises:
        ValueError: A link leads to something that is not on the site.
    """
    return re.sub(r"(?<=\]\()[^)\s]+", lambda found: _target(found.group()), text)


def _target(link: str) -> str:
    if _SCHEME.match(link):
        return link
    if not link.startswith(_DOCS):
        raise ValueError(f"`{link}` is not on the site: an example links to pages of the docs")
    return f"../{link.removeprefix(_DOCS)}"


def linked(text: str, page: str) -> str:
    """A page whose links to READMEs of examples lead to their pages.

    Args:
        text: Of the page, as it is in the repository.
        page: Its name below the docs, without ending.
    """
    up = "../" * page.count("/")
    return re.sub(rf"\]\((?:\.\./)+{FOLDER}/(\w+)/README\.md", rf"]({up}{FOLDER}/\1.md", text)
