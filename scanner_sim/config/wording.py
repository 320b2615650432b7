"""Words of messages about a scenario: what came, as YAML, and what was probably meant."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

import yaml


def inline_yaml(value: object) -> str:
    """Return a value as YAML on one line."""
    text: str = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, width=10**6, allow_unicode=True
    )
    return text.removesuffix("\n").removesuffix("\n...")


def nearest(word: object, words: tuple[str, ...] | list[str]) -> str | None:
    """Return the legal word that was probably meant, or None."""
    spelling = str(word).lower().replace("-", "_").replace(" ", "_")
    found = difflib.get_close_matches(spelling, words, n=1, cutoff=0.65)
    return found[0] if found else None


def choice(came: object, choices: Sequence[object]) -> str:
    """Say which of some words was probably meant, or name them all."""
    near = nearest(came, [str(item) for item in choices])
    known = f"Possible: {', '.join(map(str, choices))}."
    return f"Did you mean '{near}'? {known}" if near else known


def shown(value: object) -> str:
    """Return a value as a message shows it."""
    match value:
        case None:
            return "nothing (an empty value)"
        case dict():
            return "a block of keys"
        case list():
            return f"a list of {len(value)}"
        case str():
            return f"'{shorten(value)}'"
        case bool() | int() | float():
            return shorten(inline_yaml(value))
    return f"a {type(value).__name__}"


def shorten(text: str) -> str:
    """Return a text cut to what fits in a message."""
    return text if len(text) <= 60 else f"{text[:57]}…"


def capital(text: str) -> str:
    """Return a piece of a sentence as a sentence."""
    if not text:
        return ""
    return text[0].upper() + text[1:] + ("" if text.endswith((".", "?")) else ".")
