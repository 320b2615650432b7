"""Which programs made a result, in one order."""

from __future__ import annotations

import itertools

import pytest

from scanner_sim.products.provenance import PROGRAMS, in_order, software, versions


def test_versions_stand_in_one_order_whatever_a_file_has() -> None:
    """Claim: those that change a result in their own order, what else a file names after them by the alphabet, and each
    with its version; those that it does not name are left out."""
    kept = {"numpy": "2.1", "zlib": "3", "scanner-sim": "0.1", "another": "5"}
    wanted = [("scanner-sim", "0.1"), ("numpy", "2.1"), ("another", "5"), ("zlib", "3")]
    for order in itertools.permutations(kept.items()):
        assert list(in_order(dict(order)).items()) == wanted
    assert software(in_order(kept)) == "scanner-sim 0.1, numpy 2.1, another 5, zlib 3"
    assert in_order({}) == {}


def test_a_program_that_is_not_installed_has_no_version(monkeypatch: pytest.MonkeyPatch) -> None:
    assert tuple(versions()) == PROGRAMS
    monkeypatch.setattr("scanner_sim.products.provenance.PROGRAMS", ("no-such-program", "numpy"))
    found = versions()
    assert found["no-such-program"] == "unknown"
    assert found["numpy"][0].isdigit()
