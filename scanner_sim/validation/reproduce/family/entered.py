"""The instruments as they were when their held-out facts were entered: a change since then spends those facts.

A fact judges an instrument as long as it set none of its numbers. The ledger hence keeps each instrument's values, and
their digest, from the day on which its facts were entered. Values that an instrument has got since (a key that did not
exist) change nothing by themselves and are shown; a value that has changed or gone turns the held-out facts of this
instrument into used ones. ``python -m scanner_sim.validation.reproduce.family.entered NAME`` does that, and enters
the instrument anew.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import Field, TypeAdapter

from scanner_sim.config.preset import read_preset, shipped_presets
from scanner_sim.config.wording import choice, shown
from scanner_sim.foundation.errors import InputError, RunError, ScannerSimError
from scanner_sim.foundation.named_files import LARGEST_TEXT, read_ordinary
from scanner_sim.foundation.parts import Part
from scanner_sim.products.files.exchange import exchange
from scanner_sim.products.files.folder import write_text
from scanner_sim.validation.reproduce.family.ledger import Fact, shipped_ledger

FILE = Path(__file__).with_name("instruments.json")
"""The entries, beside the facts."""

COMMAND = f"python -m {__package__}.entered"
"""What enters instruments; names follow."""

Scalar = bool | int | float | str | list[Any] | None
Values = Mapping[str, Scalar]


class Entry(Part):
    """An instrument on the day on which it was entered."""

    entered: str
    """The day."""
    digest: str
    """SHA-256 of its values."""
    values: dict[str, Any]
    """Each value by its key, as its file spells it."""
    spent: dict[str, str] = Field(default={})
    """Facts that a later change has turned into used ones: when and by which change."""

    def changes(self, now: Values) -> tuple[str, ...]:
        """Return in words what has changed since."""
        return tuple(
            f"{key} was {value}, is {now[key]}" if key in now else f"{key} was {value}, is gone"
            for key, value in self.values.items()
            if key not in now or now[key] != value
        )

    def later(self, now: Values) -> tuple[str, ...]:
        """Return the keys that did not exist then."""
        return tuple(key for key in now if key not in self.values)


def values_of(name: str) -> dict[str, Scalar]:
    """Return each value of a shipped instrument by its key, what it extends included; of a named file what it holds.

    Raises
    ------
    InputError
        If a file that it names cannot be read.
    """
    return dict(_flat(read_preset(name).values))


def _flat(node: Mapping[str, Any], above: str = "") -> list[tuple[str, Scalar]]:
    found: list[tuple[str, Scalar]] = []
    for key, value in sorted(node.items()):
        path = f"{above}{key}"
        if isinstance(value, Mapping):
            found += _flat(value, f"{path}.")
        else:
            # Where a named file stands, and its name, say nothing of the instrument.
            named = isinstance(value, str) and value.lower().endswith(".csv")
            found.append((path, _held(Path(value)) if named else value))
    return found


def _held(file: Path) -> str:
    """Return what tells the content of a file from any other, in words."""
    return f"a file of SHA-256 {hashlib.sha256(read_ordinary(file, LARGEST_TEXT)).hexdigest()}"


def digest_of(values: Values) -> str:
    """Return the SHA-256 of values, whatever their order."""
    text = json.dumps(dict(values), sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def read_entries(path: Path = FILE) -> dict[str, Entry]:
    """Return the entries by the instrument's name; none where nothing was entered yet.

    Raises
    ------
    InputError
        If the file is broken, or an entry's values are not those of its digest.
    """
    if not path.is_file():
        return {}
    try:
        entries = TypeAdapter(dict[str, Entry]).validate_json(read_ordinary(path, LARGEST_TEXT))
    except ValueError as error:
        raise InputError(
            f"{path} is broken: {error}.", remedy="Take it from the last version of the program."
        ) from None
    for name, entry in entries.items():
        if digest_of(entry.values) != entry.digest:
            raise InputError(
                f"{path.name}: the values of {name} are not those of its digest: they were changed by hand.",
                remedy="Take the file from the last version of the program.",
            )
    return entries


def is_held_out(key: str, fact: Fact, entries: Mapping[str, Entry]) -> bool:
    """Return whether a fact set no default, and its instruments have not changed since it was entered."""
    if fact.use == "used":
        return False
    own = {name: entries[name] for name in fact.instruments if name in entries}
    shipped = shipped_presets()
    return not any(
        key in entry.spent or (name in shipped and entry.changes(values_of(name)))
        for name, entry in own.items()
    )


def enter(
    names: Sequence[str], entries: Mapping[str, Entry], facts: Mapping[str, Fact], day: str
) -> dict[str, Entry]:
    """Return the entries with instruments as they are now; where one has changed, its held-out facts are spent.

    Raises
    ------
    InputError
        If there is no such instrument.
    """
    made = dict(entries)
    for name in names:
        if name not in shipped_presets():
            raise InputError(
                f"there is no shipped instrument {shown(name)}.", remedy=choice(name, shipped_presets())
            )
        now, spent = values_of(name), {}
        if name in entries:
            changes, spent = entries[name].changes(now), dict(entries[name].spent)
            for key, fact in facts.items():
                if changes and name in fact.instruments and fact.use == "held out":
                    spent.setdefault(key, f"{day}: {'; '.join(changes)}")
        made[name] = Entry(entered=day, digest=digest_of(now), values=now, spent=spent)
    return made


def write_entries(entries: Mapping[str, Entry], path: Path = FILE) -> None:
    """Write the entries, whole or not at all.

    Raises
    ------
    RunError
        If the disk fails.
    """
    content = {name: entries[name].model_dump() for name in sorted(entries)}
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    try:
        exchange(path.parent, {path.name: lambda place: write_text(place, text)}, (path.name,))
    except OSError as error:
        raise RunError(f"{path} cannot be written: {error}.") from None


def main(names: Sequence[str]) -> None:
    """Enter instruments, all shipped ones where none is named, and say what came of it."""
    facts, before = shipped_ledger(), read_entries()
    after = enter(names or shipped_presets(), before, facts, datetime.now(UTC).strftime("%Y-%m-%d"))
    write_entries(after)
    for name, entry in after.items():
        spent = [key for key in entry.spent if key not in (before[name].spent if name in before else {})]
        told = f"; now used: {', '.join(spent)}" if spent else ""
        sys.stdout.write(f"{name}: {entry.digest[:12]}, entered {entry.entered}{told}\n")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except ScannerSimError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(error.exit_status)
