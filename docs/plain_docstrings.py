"""What griffe calls for each object of the reference: reStructuredText's marks become Markdown's."""

from __future__ import annotations

import re
from typing import Any

import griffe


class PlainDocstrings(griffe.Extension):
    """Turns roles and double backquotes of docstrings into plain code."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of an object, once it is loaded."""
        if obj.docstring is not None:
            text = re.sub(r":\w+:`~?(?:scanner_sim\.)?([^`]*)`", r"`\1`", obj.docstring.value)
            obj.docstring.value = text.replace("``", "`")
