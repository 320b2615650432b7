"""The paper made again: every equation, table and figure from simulated data, beside what is printed."""

from scanner_sim.validation.reproduce.item import Item, Outcome, Row, Task, Verdict
from scanner_sim.validation.reproduce.results import Result
from scanner_sim.validation.reproduce.run import all_items, reproduce

__all__ = ["Item", "Outcome", "Result", "Row", "Task", "Verdict", "all_items", "reproduce"]
