"""Under which licence the files of a scene stand, as the REUSE specification has it: in FILE.license beside FILE."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from scanner_sim.campaign.dataset.views import View, files_of_shape
from scanner_sim.foundation.errors import InputError, printable
from scanner_sim.foundation.named_files import LARGEST_MESH, digest_of, read_ordinary

_LARGEST = 1 << 16
"""Bytes of a file about a licence."""
_TAG = re.compile(r"SPDX-License-Identifier:[ \t]*([^\r\n]+)")
_HOLDER = re.compile(r"SPDX-FileCopyrightText:[ \t]*([^\r\n]+)")
NOT_STATED = "not stated"


@dataclass(frozen=True)
class LicensedFile:
    """A file that objects came from.

    Attributes
    ----------
    name
        Of the file, without its folder.
    sha256
        Of its content, in hexadecimal digits.
    licence, holder
        SPDX identifier and holder of the copyright; :data:`NOT_STATED` and empty where nothing says.
    """

    name: str
    sha256: str
    licence: str
    holder: str


def licences_of(views: Iterable[View]) -> tuple[LicensedFile, ...]:
    """Return the files that objects of the views come from, with their licences, by name.

    With those that they name for their shapes, but not for their colours.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    named = {one.file for view in views for one in view.objects if one.file is not None}
    files = {file for one in named for file in files_of_shape(one)}
    return tuple(_licensed(path) for path in sorted(files, key=lambda path: (path.name, path)))


def _licensed(path: Path) -> LicensedFile:
    text, beside = "", path.with_name(f"{path.name}.license")
    if beside.is_file():
        text = read_ordinary(beside, _LARGEST).decode("utf-8", "replace")
        if not _TAG.search(text):
            raise InputError(
                f"{beside} names no licence.", remedy="Write a line 'SPDX-License-Identifier: CC-BY-4.0'."
            )
    tag, holder = _TAG.search(text), _HOLDER.search(text)
    return LicensedFile(
        printable(path.name),
        digest_of(read_ordinary(path, LARGEST_MESH)).hex(),
        NOT_STATED if tag is None else printable(tag[1].strip()),
        "" if holder is None else printable(holder[1].strip()),
    )
