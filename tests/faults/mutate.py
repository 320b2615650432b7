"""Mutations of scenarios, plans and tracker states that know their form; each is made again from its address alone."""

from __future__ import annotations

import copy
import json
import math
import random
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from scanner_sim.campaign.plan import DISTRIBUTIONS, GRIDS
from scanner_sim.config.document import read_document
from scanner_sim.config.outline import EACH, Slot, outline

REPOSITORY = Path(__file__).resolve().parents[2]
CONFIGS = sorted((REPOSITORY / "configs").glob("*.yaml"))
PLANS = sorted((REPOSITORY / "configs" / "campaigns").glob("*.yaml"))

HUGE = (1e300, -1e300, 1.7976931348623157e308, 5e-324, 10**400, 2**63, 2**31, 2**53 + 1, -(2**63), 1e-300)
"""Numbers that are legal as YAML and nowhere meant."""
ODD_WORDS = (
    "",
    " ",
    "é\u202e\u200b",
    "a" * 5000,
    "../" * 40 + "etc/passwd",
    "/dev/zero",
    "/dev/stdin",
    "/proc/self/mem",
    "x" * 300 + ".ply",
    "~nobody/x.xml",
    "~",
    ".",
    "..",
    "a\nb",
    "\x1b[31mred\x1b[0m",
    "[bold]m[/bold]",
    "<script>",
    "%s%n",
    "{0.__class__}",
    "$(id)",
    "1e999 m",
    "nan m",
    "inf deg",
    "1 furlong/fortnight",
    "-0 m",
    "1e308 km",
    "1e-400 m",
    "1 m m m m m m",
    "0x10 mm",
    "１ m",
    "none",
    "null",
    "none.csv",
    "!!python/object/apply:os.system [id]",
)
OVERRIDE_PATHS = (
    "scene.objects.0.position.0",
    "scene.objects.99999999999999999999.name",
    "scene.objects.-1.name",
    "scene.objects.٣.name",
    "scene.objects.²",
    "scan.rows.0.0.0",
    ".",
    "..",
    "a",
    "scan." + "a." * 3000 + "b",
    "seed",
    "schema",
    "<<",
    "\x1b[2J",
    "scanner",
    "scene",
    "scan.horizontal.1",
    "lighting.sun.direction",
    "scene.objects",
)


class Mutant(NamedTuple):
    """An input that was changed: its text, overrides beside it, and the names of the changes."""

    seed_file: str
    text: bytes
    overrides: tuple[str, ...]
    edits: tuple[str, ...]


def scenario_mutant(seed: int, number: int, keep: frozenset[int] | None = None) -> Mutant:
    """Return mutant ``number`` of a run of the fuzzer; ``keep`` names the edits that count, by default all."""
    choose = random.Random(f"{seed}/{number}")
    config = choose.choice(CONFIGS)
    data = read_document(config.read_text(encoding="utf-8")).data
    _lighten(data, choose)
    names: list[str] = []
    overrides: list[str] = []
    text: bytes | None = None
    tame = 1.0 if choose.random() < 0.6 else 0.6
    for index in range(choose.choice((1, 1, 2, 2, 3, 4))):
        edit = choose.choices(("value", "place", "structure", "override", "text"), (12, 6, 4, 2, 1))[0]
        if keep is not None and index not in keep:
            continue
        rng = random.Random(f"{seed}/{number}/{index}")
        if edit == "text":
            text = _spelt(data) if text is None else text
            change = rng.choice(TEXT_EDITS)
            text = change(rng, text)
            names.append(change.__name__.strip("_"))
        elif edit == "override":
            overrides.append(_override(rng, tame))
            names.append(f"--set {overrides[-1][:60]!r}")
        elif text is None:
            names.append(_EDITS[edit](rng, data, tame))
    return Mutant(config.name, _spelt(data) if text is None else text, tuple(overrides), tuple(names))


def plan_mutant(seed: int, number: int, keep: frozenset[int] | None = None) -> Mutant:
    """Return mutant ``number`` of a shipped plan of a campaign."""
    choose = random.Random(f"{seed}/plan/{number}")
    original = choose.choice(PLANS)
    data, names = read_document(original.read_text(encoding="utf-8")).data, list[str]()
    if choose.random() < 0.8:
        # Of the scenarios some are large, and each plan reads its own.
        data |= {"base": "../plane.yaml", "set": {"scan.rows": 4, "scan.columns": 4}}
    text: bytes | None = None
    for index in range(choose.choice((1, 1, 2, 2, 3, 4))):
        edit = choose.choices(("vary", "value", "structure", "text"), (8, 6, 4, 2))[0]
        if keep is not None and index not in keep:
            continue
        rng = random.Random(f"{seed}/plan/{number}/{index}")
        if edit == "text":
            change = rng.choice(TEXT_EDITS)
            text = change(rng, _spelt(data) if text is None else text)
            names.append(change.__name__.strip("_"))
        elif text is None:
            names.append(_vary(rng, data) if edit == "vary" else _EDITS[edit](rng, data, 0.6))
    return Mutant(original.name, _spelt(data) if text is None else text, (), tuple(names))


def _vary(rng: random.Random, data: Any) -> str:
    """Let keys of the scenario vary by any form, with any settings of their group."""
    group: dict[str, Any] = {"keys": {}}
    for _ in range(rng.choice((1, 1, 2, 3))):
        key = rng.choice((_place_in_words(rng), *MEANT, rng.choice(OVERRIDE_PATHS)))
        slots = _BY_WORDS.get(tuple(EACH if step == "0" else step for step in key.split(".")), [Slot()])
        ends = [legal(rng, rng.choice(slots)) if rng.random() < 0.8 else odd(rng) for _ in range(2)]
        form = rng.choice(("list", *GRIDS, *DISTRIBUTIONS))
        group["keys"][key] = {form: ends} | ({"count": rng.choice((2, 3, 0, 10**6))} if form in GRIDS else {})
        if rng.random() < 0.2:
            group["keys"][key]["within"] = [odd(rng), odd(rng)]
    if rng.random() < 0.8:
        group["count"] = rng.choice((1, 2, 4, 16, 16, 17, 10**5, 10**7, odd(rng)))
    if rng.random() < 0.8:
        group["sample"] = rng.choice(("random", "sobol", "latin_hypercube", "saltelli", "saltelli", "x"))
    if rng.random() < 0.5 or not isinstance(data, dict) or not isinstance(data.get("vary"), list):
        data["vary"] = []
    data["vary"].append(group)
    return f"vary {str(group)[:100]}"


MEANT = (
    "scanner.laser.power",
    "lighting.orbit.beta",
    "scene.objects.0.position.2",
    "seed",
    "scan.rows",
    "ranging",
)
"""Keys that plans vary."""


def _lighten(data: dict[str, Any], choose: random.Random) -> None:
    """Put a small scene in the place of the large one, most of the time: loading it would take all the time."""
    for item in data.get("scene", {}).get("objects", ()):
        if "node_z1" in str(item.get("file")) and choose.random() < 0.9:
            item["file"] = "../scenes/step.xml"


def _spelt(data: Any) -> bytes:
    text: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=10**6)
    return text.encode("utf-8", "surrogatepass")


def _override(rng: random.Random, tame: float) -> str:
    place = _place_in_words(rng) if rng.random() < tame else rng.choice(OVERRIDE_PATHS)
    slots = _BY_WORDS.get(tuple(EACH if step == "0" else step for step in place.split(".")), [Slot()])
    value = legal(rng, rng.choice(slots)) if rng.random() < tame else odd(rng)
    text = value if isinstance(value, str) else repr(value)
    return f"{place}={text}" if rng.random() < 0.95 else place


def _place_in_words(rng: random.Random) -> str:
    place = rng.choice([place for place in outline() if place])
    return ".".join("0" if step == EACH else step for step in place if not step.startswith("("))


def odd(rng: random.Random, depth: int = 0) -> Any:
    """Return any value: of a wrong kind, too large, nested, not a number."""
    match rng.randrange(9):
        case 0:
            return rng.choice(HUGE)
        case 1:
            return rng.choice((math.inf, -math.inf, math.nan, None, True, False, 0, -1, 0.0, -0.0))
        case 2 | 3:
            return rng.choice(ODD_WORDS)
        case 4:
            return [odd(rng, depth + 1) for _ in range(rng.randrange(5))] if depth < 3 else []
        case 5:
            return {rng.choice(("type", "x", "name", "0")): odd(rng, depth + 1)} if depth < 3 else {}
        case 6:
            return f"{rng.choice(HUGE)} {rng.choice(('m', 'deg', 'W', 's', 'Hz', 'K', '%', 'dB'))}"
        case 7:
            return (
                f"{rng.choice((0, -1, 1, 1e9, 1e-9))} {rng.choice(('m', 'deg', 'W', 's', 'Hz', 'K', 'nm'))}"
            )
        case _:
            return rng.randrange(-3, 70)


def legal(rng: random.Random, slot: Slot) -> Any:
    """Return a value that a place may hold, its bounds above all."""
    if slot.choices and rng.random() < 0.8:
        return rng.choice(slot.choices)
    low, high = _bounds(slot)
    if slot.dimension is not None:
        if not math.isfinite(low + high) and rng.random() < 0.8:
            return _nudged(rng, rng.choice(slot.dimension.examples))
        return slot.dimension.format(_within(rng, low, high))
    kinds = str(slot.field.annotation) if slot.field is not None else ""
    if "bool" in kinds:
        return rng.choice((True, False))
    if "int" in kinds:
        return round(_within(rng, max(low, -(2.0**53)), min(high, 2.0**53)))
    if "float" in kinds:
        return _within(rng, low, high)
    if slot.field is not None and slot.field.examples:
        return copy.deepcopy(rng.choice(slot.field.examples))
    if slot.part is not None:
        return part(rng, slot)
    return odd(rng)


def part(rng: random.Random, slot: Slot, depth: int = 0) -> Any:
    """Return a block of some of the keys of a part."""
    assert slot.part is not None
    block = {}
    for name, field in slot.part.model_fields.items():
        key = field.alias or name
        # What a scenario leaves out of the scanner its preset has.
        required = field.is_required() and slot.location[:1] != ("scanner",)
        if required or rng.random() < 0.3:
            inside = outline().get((*slot.location, key), Slot())
            deeper = inside.part is not None and depth < 3
            block[key] = part(rng, inside, depth + 1) if deeper else legal(rng, inside)
    return block


def _bounds(slot: Slot) -> tuple[float, float]:
    low, high = -math.inf, math.inf
    for item in () if slot.field is None else slot.field.metadata:
        low = max(low, float(getattr(item, "ge", getattr(item, "gt", low))))
        high = min(high, float(getattr(item, "le", getattr(item, "lt", high))))
    return low, high


def _within(rng: random.Random, low: float, high: float) -> float:
    """Return a number between two bounds: an end, just inside of it, or any size between."""
    low, high = max(low, -1e6), min(high, max(1e6, 10.0 * abs(low) if math.isfinite(low) else 1e6))
    match rng.randrange(5):
        case 0:
            return low
        case 1:
            return high
        case 2:
            return math.nextafter(rng.choice((low, high)), rng.choice((low, high)))
        case 3 if high > 0.0:
            smallest = max(low, high * 1e-12)
            return float(math.exp(rng.uniform(math.log(smallest), math.log(high))))
    return rng.uniform(low, high)


def _containers(data: Any, place: tuple[str | int, ...] = ()) -> list[tuple[Any, Any, tuple[str | int, ...]]]:
    """Return every value of plain data as its container, its key there and its place."""
    found = []
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        here = (*place, key)
        found.append((data, key, here))
        found += _containers(value, here)
    return found


def _slots_of(place: tuple[str | int, ...]) -> list[Slot]:
    """Return the slots that a place may be, whatever the tags of unions on its way."""
    wanted = tuple(EACH if isinstance(step, int) else step for step in place)
    return _BY_WORDS.get(wanted, [])


def _by_words() -> dict[tuple[str, ...], list[Slot]]:
    found: dict[tuple[str, ...], list[Slot]] = {}
    for place, slot in outline().items():
        found.setdefault(tuple(step for step in place if not step.startswith("(")), []).append(slot)
    return found


_BY_WORDS = _by_words()


def _change_value(rng: random.Random, data: Any, tame: float) -> str:
    """Give a value that is there another one: legal most of the time."""
    places = _containers(data) or [({}, "x", ("x",))]
    single = [entry for entry in places if not isinstance(_at(entry), dict | list)]
    holder, key, place = rng.choice(single if single and rng.random() < 0.8 else places)
    slots = _slots_of(place)
    nearby = _nudged(rng, _at((holder, key, place))) if rng.random() < 0.4 else None
    if nearby is not None:
        holder[key] = nearby
    elif slots and rng.random() < tame:
        holder[key] = legal(rng, rng.choice(slots))
    else:
        holder[key] = odd(rng)
    return f"{'.'.join(map(str, place))} = {str(holder[key])[:60]!r}"


def _nudged(rng: random.Random, value: Any) -> Any:
    """Return a number, with its unit, that is a little or a lot different; None where there is none."""
    factor = rng.choice((0.5, 0.9, 0.999999, 1.000001, 1.1, 2.0, 10.0, 0.1, 1e3, 1e-3, 0.0, -1.0))
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return round(value * factor) if rng.random() < 0.7 else value + rng.choice((-1, 1))
    if isinstance(value, float):
        return value * factor
    number, space, unit = value.partition(" ") if isinstance(value, str) else ("", "", "")
    try:
        return f"{float(number) * factor:.6g}{space}{unit}"
    except ValueError:
        return None


def _at(entry: tuple[Any, Any, Any]) -> Any:
    holder, key, _ = entry
    return holder.get(key) if isinstance(holder, dict) else holder[key]


def _add_key(rng: random.Random, data: Any, tame: float) -> str:
    """Write a key that was left out, anywhere in the outline."""
    place = rng.choice([words for words in _BY_WORDS if words])
    slot = rng.choice(_BY_WORDS[place])
    value = legal(rng, slot) if rng.random() < tame else odd(rng)
    holder = data
    for step, following in pairwise(place):
        if step == EACH:
            if not isinstance(holder, list) or not holder:
                return "nowhere"
            holder = rng.choice(holder)
            continue
        if not isinstance(holder, dict):
            return "nowhere"
        if not isinstance(holder.get(step), dict | list):
            holder[step] = [{}] if following == EACH else {}
        holder = holder[step]
    if place[-1] == EACH and isinstance(holder, list):
        holder.append(value)
    elif isinstance(holder, dict):
        holder[place[-1]] = value
    return f"{'.'.join(place)} := {str(value)[:60]!r}"


def _restructure(rng: random.Random, data: Any, tame: float) -> str:
    """Delete, double, exchange or wrap something."""
    places = _containers(data)
    holder, key, place = rng.choice(places or [({}, "x", ("x",))])
    what = rng.choice(("delete", "double", "exchange", "wrap", "grow", "rename"))
    if what == "delete":
        holder.pop(key, None) if isinstance(holder, dict) else holder.pop(key)
    elif what == "double" and isinstance(holder, list):
        holder.insert(key, copy.deepcopy(holder[key]))
    elif what == "exchange" and places:
        other, there, _ = rng.choice(places)
        holder[key] = copy.deepcopy(other[there])
    elif what == "wrap":
        holder[key] = [_at((holder, key, place))]
    elif what == "grow" and isinstance(holder, list):
        holder.extend(copy.deepcopy(holder[key]) for _ in range(rng.choice((1, 10, 2000))))
    elif what == "rename" and isinstance(holder, dict):
        holder[rng.choice((f"{key}x", "type", "\u202e", "name"))] = holder.pop(key, None)
    return f"{what} {'.'.join(map(str, place))}"


_EDITS: dict[str, Callable[[random.Random, Any, float], str]] = {
    "value": _change_value,
    "place": _add_key,
    "structure": _restructure,
}


def _flip(rng: random.Random, text: bytes) -> bytes:
    changed = bytearray(text)
    for _ in range(rng.choice((1, 3, 20))):
        changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


def _truncate(rng: random.Random, text: bytes) -> bytes:
    return text[: rng.randrange(len(text))]


def _insert(rng: random.Random, text: bytes) -> bytes:
    pieces = (
        b"\x00",
        b"\t",
        b"\xef\xbb\xbf",
        b"\xff\xfe",
        b"\x1b[2J",
        b"\xc2\x85",
        b"\r",
        b"---\n",
        b"...\n",
    )
    more = (
        b"!!binary ",
        b"!!python/name:os.system ",
        b"&a ",
        b"*a ",
        b"<<: ",
        b"? ",
        b"- ",
        b"2001-01-01 ",
        b"1_0:30 ",
    )
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice(pieces + more) + text[at:]


def _nest(rng: random.Random, text: bytes) -> bytes:
    depth = rng.choice((60, 2000, 200_000))
    opening, closing = rng.choice(
        ((b"[", b"]"), (b"{a: ", b"}"), (b"- ", b""), (b"? ", b""), (b"!!seq [", b"]"))
    )
    return text + b"\nextra: " + opening * depth + closing * depth + b"\n"


def _bomb(rng: random.Random, text: bytes) -> bytes:
    lines = [b"a0: &a0 [x, x, x, x, x, x, x, x]"]
    for level in range(1, rng.choice((3, 12))):
        lines.append(b"a%d: &a%d [" % (level, level) + b", ".join([b"*a%d" % (level - 1)] * 8) + b"]")
    return b"\n".join(lines) + b"\n" + text


def _twice(rng: random.Random, text: bytes) -> bytes:
    lines = text.split(b"\n")
    at = rng.randrange(len(lines))
    return b"\n".join([*lines[: at + 1], *lines[at:]])


def _recode(rng: random.Random, text: bytes) -> bytes:
    return text.decode("utf-8", "replace").encode(
        rng.choice(("utf-16", "utf-32", "latin-1", "utf-8-sig")), "replace"
    )


def _long_number(rng: random.Random, text: bytes) -> bytes:
    digits = b"9" * rng.choice((400, 5000, 100_000))
    return text.replace(b": ", b": " + digits + rng.choice((b"", b".5", b"e9", b" m")) + b"\nx: ", 1)


TEXT_EDITS = (_flip, _truncate, _insert, _nest, _bomb, _twice, _recode, _long_number)


def state_mutant(seed: int, number: int, original: str, keep: frozenset[int] | None = None) -> Mutant:
    """Return mutant ``number`` of a saved tracker state, whose text is ``original``."""
    choose = random.Random(f"{seed}/state/{number}")
    content, names = json.loads(original), []
    text: bytes | None = None
    for index in range(choose.choice((1, 1, 2, 3))):
        kind = choose.choices(("value", "structure", "text"), (10, 3, 1))[0]
        if keep is not None and index not in keep:
            continue
        rng = random.Random(f"{seed}/state/{number}/{index}")
        if kind == "text":
            change = rng.choice((_flip, _truncate, _insert, _recode))
            text = change(rng, json.dumps(content).encode() if text is None else text)
            names.append(change.__name__.strip("_"))
            continue
        if text is not None:
            continue
        places = [entry for entry in _containers(content) if entry[2][0] == "state" or rng.random() < 0.1]
        if kind == "structure":
            names.append(
                _restructure(
                    rng, content["state"] if isinstance(content.get("state"), dict) else content, 0.0
                )
            )
            continue
        holder, key, place = rng.choice(places or [({}, "x", ("x",))])
        holder[key] = _state_value(rng, holder[key] if holder else None)
        names.append(f"{'.'.join(map(str, place))} = {str(holder[key])[:60]!r}")
    return Mutant(
        "state", json.dumps(content).encode("utf-8", "replace") if text is None else text, (), tuple(names)
    )


def _state_value(rng: random.Random, old: Any) -> Any:
    numbers = (
        0,
        -1,
        1,
        99,
        2**31,
        2**63,
        1e9,
        -1e9,
        1e300,
        1e-300,
        math.nan,
        math.inf,
        -math.inf,
        0.5,
        1.5,
        3.0,
    )
    if isinstance(old, list) and rng.random() < 0.5:
        return rng.choice(([], old + old, old[:-1], [old], None, "x", {}))
    if isinstance(old, int | float) and not isinstance(old, bool) and rng.random() < 0.3:
        return old * rng.choice((-1.0, 2.0, 1e-3, 1.0 + 1e-9, 1e6))
    return rng.choice(numbers) if rng.random() < 0.7 else odd(rng)
