"""The description of a data set, as the vocabulary of Croissant 1.1 wants it."""

from __future__ import annotations

from typing import Any

import pytest

from scanner_sim.campaign.dataset.croissant import croissant
from scanner_sim.campaign.dataset.licences import NOT_STATED, LicensedFile
from scanner_sim.campaign.dataset.shards import Field

FIELDS = (
    Field("split", "1", "which part", "string", ()),
    Field("range", "m", "how far", "float32", (3, -1)),
    Field("count", "1", "how many", "int64", ()),
)
FILES = (
    LicensedFile("own.ply", "ab12", NOT_STATED, ""),
    LicensedFile("free.obj", "cd34", "CC0-1.0", "A. Holder"),
    LicensedFile("other.stl", "ef56", "https://example.org/terms", ""),
)


def described(licence: str = "MIT") -> dict[str, Any]:
    shards = {"train-0.parquet": "1f", "test-0.parquet": "2e"}
    return croissant("set", "views of parts", licence, "scanner-sim 9", shards, FIELDS, FILES)


def test_each_shard_is_a_file_and_all_of_them_a_set() -> None:
    """Claim: every file under its own name with its digest, and one set of which each field is a column."""
    made = described()
    *files, whole = made["distribution"]
    assert files == [
        {
            "@type": "cr:FileObject", "@id": name, "name": name, "contentUrl": name, "sha256": digest,
            "encodingFormat": "application/x-parquet",
        }
        for name, digest in (("train-0.parquet", "1f"), ("test-0.parquet", "2e"))
    ]  # fmt: skip
    assert (whole["@type"], whole["@id"], whole["name"]) == ("cr:FileSet", "shards", "shards")
    assert (whole["includes"], whole["encodingFormat"]) == ("*.parquet", "application/x-parquet")
    (records,) = made["recordSet"]
    assert (records["@type"], records["@id"], records["name"]) == ("cr:RecordSet", "views", "views")
    about: list[tuple[str, Any, dict[str, Any]]] = [
        ("which part", ["cr:Split", "sc:Text"], {}),
        ("how far [m]", "cr:Float32", {"isArray": True, "arrayShape": "3,-1"}),
        ("how many", "cr:Int64", {}),
    ]
    assert records["field"] == [
        {
            "@type": "cr:Field", "@id": f"views/{field.name}", "name": field.name, "description": words,
            "dataType": kind,
            "source": {"fileSet": {"@id": whole["@id"]}, "extract": {"column": field.name}}, **shape,
        }
        for field, (words, kind, shape) in zip(FIELDS, about, strict=True)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("licence", "address"),
    [
        ("", None),
        ("MIT", "https://spdx.org/licenses/MIT.html"),
        ("https://example.org/l", "https://example.org/l"),
    ],
)
def test_a_set_names_its_licence_and_what_it_comes_from(licence: str, address: str | None) -> None:
    """Claim: SPDX identifiers by their address, addresses as they are, and nothing where nothing is stated."""
    made = described(licence)
    assert made.get("license") == address
    assert (made["name"], made["description"]) == ("set", "views of parts")
    assert made["creator"] == {"@type": "sc:Organization", "name": "scanner-sim 9"}
    work = {"@type": "sc:CreativeWork"}
    assert made["isBasedOn"] == [
        work | {"name": "own.ply", "identifier": "sha256:ab12"},
        work | {
            "name": "free.obj", "identifier": "sha256:cd34", "license": "https://spdx.org/licenses/CC0-1.0.html",
            "copyrightHolder": "A. Holder",
        },
        work | {"name": "other.stl", "identifier": "sha256:ef56", "license": "https://example.org/terms"},
    ]  # fmt: skip
    assert made["conformsTo"] == "http://mlcommons.org/croissant/1.1"
    assert made["@type"] == "sc:Dataset"


def test_terms_of_croissant_are_its_own() -> None:
    """Claim: in the context a term of Croissant is its name behind ``cr:``, but for the words of Dublin Core and those
    of schema.org, which is what is meant where nothing is said."""
    context = described()["@context"]
    assert context["@vocab"] == context["sc"] == "https://schema.org/"
    assert context["cr"] == "http://mlcommons.org/croissant/"
    assert context["conformsTo"] == "dct:conformsTo"
    plain = {name: term for name, term in context.items() if isinstance(term, str) and term.startswith("cr:")}
    assert {name: f"cr:{name}" for name in plain} == plain
    assert {"fileSet", "field", "recordSet", "column", "extract", "source", "includes"} < set(plain)
    of_json = {name: term for name, term in context.items() if isinstance(term, dict) and "@id" in term}
    assert {name: f"cr:{name}" for name in of_json} == {name: term["@id"] for name, term in of_json.items()}
