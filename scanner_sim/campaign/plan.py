"""The plan of a campaign: which keys of a scenario vary and how, how often, and what is measured."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from scanner_sim.campaign.measures import MEASURES
from scanner_sim.campaign.sensitivity import BESIDE_KEYS
from scanner_sim.config.wording import choice, shown
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, InputFile, Part

MOST_RUNS = 10_000_000
"""Runs of a campaign."""

ScenarioFile = Annotated[Path, InputFile((".yaml", ".yml")), Field(examples=["plane.yaml"])]
Ends = Annotated[tuple[Any, Any], Field(examples=[["5 mW", "15 mW"]])]
"""Two values of a key, as a scenario spells them, the first below the second."""

GRIDS = ("linear", "logarithmic")
"""Forms whose values are spaced evenly."""
DISTRIBUTIONS = ("uniform", "log_uniform", "sine_uniform", "normal")
"""Forms whose values are drawn."""
POWERS_OF_TWO = ("sobol", "saltelli")
"""Samples that are even in powers of two only."""


class Values(Part):
    """What a key of the scenario becomes, run by run; exactly one form."""

    list: tuple[Any, ...] | None = Field(default=None, examples=[["5 mW", "15 mW"]])
    """These values, whatever the key takes: numbers with units, words, blocks. A plain list is short for it."""
    linear: Ends | None = None
    """``count`` values from the first to the last in even steps."""
    logarithmic: Ends | None = None
    """``count`` values from the first to the last in even ratios."""
    uniform: Ends | None = None
    """Drawn evenly between two values."""
    log_uniform: Ends | None = None
    """Drawn between two values so that their logarithm is even."""
    sine_uniform: Annotated[Ends | None, Field(examples=[["-90 deg", "90 deg"]])] = None
    """Drawn between two angles so that their sine is even, as heights above a horizon are of directions that are."""
    normal: Annotated[tuple[Any, Any], Field(examples=[["15 mW", "0.5 mW"]])] | None = None
    """Drawn from a normal distribution of a mean and a standard deviation."""
    within: Ends | None = None
    """Values beyond which a normal distribution is cut off; what remains is drawn in proportion."""
    count: Count | None = Field(default=None, ge=2, le=100_000, examples=[8])
    """Number of values of ``linear`` and ``logarithmic``."""

    @model_validator(mode="before")
    @classmethod
    def _short(cls, data: Any) -> Any:
        return {"list": data} if isinstance(data, list | tuple) else data

    @property
    def form(self) -> str:
        """The form that is given."""
        return next(name for name in ("list", *GRIDS, *DISTRIBUTIONS) if getattr(self, name) is not None)

    @property
    def drawn(self) -> bool:
        """Whether the values are drawn."""
        return self.form in DISTRIBUTIONS

    def cross_checks(self) -> Iterator[Fault]:
        """Yield forms that exclude one another, an empty list, and a count where there is nothing to count."""
        forms = [name for name in ("list", *GRIDS, *DISTRIBUTIONS) if getattr(self, name) is not None]
        if len(forms) != 1:
            known = ", ".join(("list", *GRIDS, *DISTRIBUTIONS))
            problem = f"it has the forms {' and '.join(forms)}." if forms else "it has no form of values."
            yield Fault("", problem, f"Write one of {known}.")
            return
        if self.list is not None and not self.list:
            yield Fault("list", "it is empty.", "Write the values.")
        if (forms[0] in GRIDS) != (self.count is not None):
            problem = "linear and logarithmic need it." if self.count is None else f"{forms[0]} has none."
            yield Fault("count", problem, "Write count: 8." if self.count is None else "Remove it.")
        if self.within is not None and forms[0] != "normal":
            yield Fault("within", f"{forms[0]} has its ends already.", "Remove it.")


class Group(Part):
    """Keys that vary together; groups are crossed with one another."""

    keys: dict[str, Values] = Field(examples=[{"scanner.laser.power": ["5 mW", "15 mW"]}])
    """Values by key: ``scanner.laser.power``, ``scene.objects.wall.position[2]``. Those of several keys are paired."""
    sample: Literal["random", "sobol", "latin_hypercube", "saltelli"] = "random"
    """How drawn values fill their space: independently, by Sobol's scrambled points, as a Latin hypercube, or by
    Saltelli's design, from which Sobol's indices of sensitivity follow."""
    count: Count | None = Field(default=None, ge=1, le=MOST_RUNS, examples=[64])
    """Number of drawn points; of Saltelli's design the rows, each of as many runs as there are keys and three."""

    @property
    def drawn(self) -> bool:
        """Whether any of the values is drawn."""
        return any(values.drawn for values in self.keys.values())

    @property
    def length(self) -> int:
        """Number of points."""
        if self.sample == "saltelli":
            return (self.count or 0) * (len(self.keys) + BESIDE_KEYS)
        return self.count or next(
            (values.count or len(values.list or ()) for values in self.keys.values()), 0
        )

    def cross_checks(self) -> Iterator[Fault]:
        """Yield lengths that do not fit together, and settings of a sample that is not drawn."""
        if not self.keys:
            yield Fault(
                "keys", "it is empty.", "Write for example keys: {scanner.laser.power: [5 mW, 15 mW]}."
            )
            return
        if self.drawn and self.count is None:
            yield Fault(
                "count",
                "this key is missing: values are drawn, so their number is.",
                "Write for example count: 64.",
            )
            return
        if not self.drawn and (self.count is not None or self.sample != "random"):
            where = "sample" if self.count is None else "count"
            yield Fault(
                where,
                "nothing is drawn in this group.",
                f"Remove it, or write one of {', '.join(DISTRIBUTIONS)}.",
            )
            return
        if self.sample in POWERS_OF_TWO and self.count is not None and math.log2(self.count) % 1.0:
            near = 2 ** round(math.log2(self.count))
            yield Fault(
                "count",
                f"Sobol's points are even in powers of two only, and {self.count} is none.",
                f"Write {near}.",
            )
        if self.sample == "saltelli":
            for key in (key for key, values in self.keys.items() if not values.drawn):
                problem = f"{key}: its values are not drawn, and Sobol's indices are of drawn ones."
                yield Fault("keys", problem, f"Write {' or '.join(DISTRIBUTIONS)}, or a group of its own.")
            return
        for key, values in self.keys.items():
            own = values.count or (0 if values.list is None else len(values.list))
            if not values.drawn and own != self.length:
                problem = f"it has {own} values, and the others of its group {self.length}: keys of a group are paired."
                yield Fault(
                    "keys", f"{key}: {problem}", "Give both as many, or write it into a group of its own."
                )


KeptRuns = Annotated[
    Annotated[Literal["none", "all"], Tag("(word)")] | Annotated[tuple[Count, ...], Tag("(numbers)")],
    Discriminator(lambda value: "(word)" if isinstance(value, str) else "(numbers)"),
]


class Keep(Part):
    """Which runs keep their whole result in files; the scenario's ``output`` says which."""

    runs: KeptRuns = Field(default="none", examples=["all"])
    """None, all, or the numbers of some."""


class Plan(Part):
    """A campaign: the same plan gives the same runs, each by its number and the seed alone."""

    schema_version: Literal[1] = Field(alias="schema", examples=[1])
    """Version of the plan's form."""
    base: ScenarioFile
    """The scenario from which every run is made."""
    changes: dict[str, Any] = Field(default={}, alias="set", examples=[{"scan.rows": 16}])
    """Values that all runs have in the place of the scenario's."""
    seed: Count = Field(default=0, ge=0, lt=2**63)
    """Seed of the drawn values and of every run's own seed."""
    vary: tuple[Group, ...] = Field(
        default=(), examples=[[{"keys": {"scanner.laser.power": ["5 mW", "15 mW"]}}]]
    )
    """Groups of keys; each is an axis of the campaign, and all are crossed."""
    repeat: Count = Field(default=1, ge=1, le=MOST_RUNS)
    """Runs of each combination, each with a seed of its own."""
    measure: tuple[str, ...] = Field(
        default=("sigma_range", "valid_share"), examples=[["sigma_range", "valid_share"]]
    )
    """What is kept of each run as numbers."""
    keep: Keep = Keep()
    """Whole results that are kept."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes: the groups, then the repetitions."""
        return (*(group.length for group in self.vary), self.repeat)

    @property
    def runs(self) -> int:
        """Number of runs."""
        return math.prod(self.shape)

    def cross_checks(self) -> Iterator[Fault]:
        """Yield measures that there are not, keys that vary twice, and more runs than a campaign may have."""
        for number, name in enumerate(self.measure):
            if name not in MEASURES:
                yield Fault(
                    f"measure.{number}", f"{shown(name)} is no measure.", choice(name, tuple(MEASURES))
                )
        if self.runs > MOST_RUNS:
            yield Fault(
                "vary", f"these are {self.runs:.3g} runs; {MOST_RUNS:.3g} are possible.", "Take fewer values."
            )
        designs = [number for number, group in enumerate(self.vary) if group.sample == "saltelli"]
        for number in designs[1:]:
            remedy = "Write the keys of both into one."
            yield Fault(f"vary.{number}.sample", "another group is of Saltelli's design already.", remedy)
        seen: set[str] = set()
        for number, group in enumerate(self.vary):
            for key in group.keys:
                if key in seen:
                    yield Fault(
                        f"vary.{number}.keys", f"{key} varies in another group already.", "Keep one of them."
                    )
                seen.add(key)
                if key == "seed" and designs:
                    problem = "seed: Saltelli's design of another group gives the seeds."
                    yield Fault(
                        f"vary.{number}.keys", problem, "Remove it: its indices are told beside the keys'."
                    )
        if not isinstance(self.keep.runs, str):
            for number, run in enumerate(self.keep.runs):
                if not 0 <= run < self.runs:
                    yield Fault(
                        f"keep.runs.{number}",
                        f"there is no run {run}.",
                        f"They go from 0 to {self.runs - 1}.",
                    )
