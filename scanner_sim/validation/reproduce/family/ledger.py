"""The ledger: published facts, each with its number, its source, and whether it set a default or was held out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import date
from functools import cache
from importlib.resources import files
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from scanner_sim.config.document import read_document, spell
from scanner_sim.config.faults import faults_found
from scanner_sim.foundation.errors import Fault, ScenarioError
from scanner_sim.foundation.parts import Number, Part

Words = Annotated[str, Field(min_length=1)]

FILE = "facts.yaml"
"""The ledger's own file, beside this one."""


class Source(Part):
    """Where a fact is printed."""

    of: Words = Field(examples=["A. Author, Journal 1 (2000) 1"])
    """Reference."""
    at: str = ""
    """Address under which its text was found; empty for none."""
    read: date | None = Field(default=None, examples=["2026-11-23"])
    """Day on which the number was read there; without it the number was handed down and never seen in print."""


class Published(Part):
    """The interval of a published number."""

    at_least: Number | None = Field(default=None, examples=[0.35])
    """Lower end; none where nothing bounds it from below."""
    at_most: Number | None = Field(default=None, examples=[0.5])
    """Upper end; none where nothing bounds it from above."""
    unit: str = Field(examples=["mm"])
    """Of both; empty for a plain number."""
    says: Words = Field(examples=["0.5 mm"])
    """The number as it is printed."""
    why: Words = Field(examples=["a bound as it is stated"])
    """How the interval follows from what is printed."""
    ours: bool = False
    """Whether print has only words and the interval is a bound of our own: what keeps it is alike in kind."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield ends that do not ascend, and an interval without any."""
        if self.at_least is None and self.at_most is None:
            yield Fault("at_most", "an interval needs an end.", "Write at_least, at_most or both.")
        elif self.at_least is not None and self.at_most is not None and self.at_least >= self.at_most:
            yield Fault("at_most", "the ends must ascend.", "Write the smaller number as at_least.")


class Elsewhere(Part):
    """A comparison of the paper's page that judges the fact already."""

    item: Words = Field(examples=["fig13"])
    """Key of the item."""
    row: Words = Field(examples=["error of the depth at 10 m"])
    """How its comparison begins."""


class Fact(Part):
    """One published fact."""

    title: Words = Field(examples=["The narrowest crack"])
    """Its name on the page."""
    says: Words = Field(examples=["Cracks 0.5 mm wide are seen from up to 4 m."])
    """What is published, in our words."""
    kind: Literal["measured", "specification", "maker's statement", "closed form"]
    """What sort of number it is."""
    sources: tuple[Source, ...] = Field(min_length=1, examples=[[{"of": "A. Author, Journal 1 (2000) 1"}]])
    """Where it is printed."""
    use: Literal["used", "held out"]
    """Whether it set a default of an instrument, or none."""
    entered: date = Field(examples=["2026-11-23"])
    """Day on which it was entered."""
    instruments: tuple[Words, ...] = Field(default=(), examples=[["nrc_2000"]])
    """The shipped instruments that are held to it."""
    quantity: Words = Field(examples=["narrowest crack that is seen at 4 m"])
    """What is compared."""
    published: Published
    """The number and its interval."""
    how: Words = Field(examples=["A plate with a groove is scanned."])
    """From what simulated data the number comes, and by which criterion."""
    reason: Words = Field(examples=["The groove sends less light back."])
    """Why the simulation stands to it as it does."""
    elsewhere: Elsewhere | None = None
    """Comparison of the paper's page that judges it."""
    not_judged: str = ""
    """Why it cannot be judged."""


class Ledger(Part):
    """The ledger's file."""

    schema_version: Literal[1] = Field(alias="schema", examples=[1])
    """Version of its form."""
    facts: dict[str, Fact]
    """Facts by key, in the order of the page."""


def read_ledger(text: str, source: str = FILE) -> Mapping[str, Fact]:
    """Return the facts of a ledger by key.

    Raises
    ------
    ScenarioError
        If the text has faults; all of them are told, with lines.
    """
    document = read_document(text)
    faults, facts = list(document.faults), dict[str, Fact]()
    if document.readable:
        try:
            facts = Ledger.model_validate(document.data).facts
        except ValidationError as error:
            faults += [
                Fault(spell(one.location), one.problem, one.remedy, document.line(one.location))
                for one in faults_found(error, document.data, root=Ledger)
            ]
    if faults:
        raise ScenarioError(faults, source=source)
    return facts


@cache
def shipped_ledger() -> Mapping[str, Fact]:
    """Return the shipped ledger."""
    return read_ledger(files(__package__).joinpath(FILE).read_text(encoding="utf-8"))
