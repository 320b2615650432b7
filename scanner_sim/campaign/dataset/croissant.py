"""The description of a data set in Croissant 1.1, by which loaders find its files and fields (docs.mlcommons.org)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scanner_sim.campaign.dataset.licences import NOT_STATED, LicensedFile
from scanner_sim.campaign.dataset.shards import Field

PARQUET = "application/x-parquet"
_TYPES = {
    "string": "sc:Text",
    "float32": "cr:Float32",
    "float64": "cr:Float64",
    "int32": "cr:Int32",
    "int64": "cr:Int64",
    "uint8": "cr:UInt8",
    "uint16": "cr:UInt16",
}
_CONTEXT: Mapping[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "name": {"@container": "@language"},
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}


def croissant(
    name: str,
    description: str,
    licence: str,
    software: str,
    shards: Mapping[str, str],
    fields: Sequence[Field],
    files: Sequence[LicensedFile],
) -> dict[str, Any]:
    """Return the description as JSON-LD.

    Parameters
    ----------
    name, description
        Of the data set.
    licence
        Of the data set: an SPDX identifier or an address; empty where none is stated.
    software
        What made it.
    shards
        SHA-256 of each shard by the name of its file.
    fields
        The columns.
    files
        Those that the shapes came from: ``isBasedOn``.
    """
    stated = {"license": _address(licence)} if licence else {}
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": name,
        "description": description,
        **stated,
        "creator": {"@type": "sc:Organization", "name": software},
        "isBasedOn": [
            {
                "@type": "sc:CreativeWork",
                "name": file.name,
                "identifier": f"sha256:{file.sha256}",
                **({} if file.licence == NOT_STATED else {"license": _address(file.licence)}),
                **({"copyrightHolder": file.holder} if file.holder else {}),
            }
            for file in files
        ],
        "distribution": [
            *(
                {
                    "@type": "cr:FileObject",
                    "@id": shard,
                    "name": shard,
                    "contentUrl": shard,
                    "encodingFormat": PARQUET,
                    "sha256": digest,
                }
                for shard, digest in shards.items()
            ),
            {
                "@type": "cr:FileSet",
                "@id": "shards",
                "name": "shards",
                "description": "all shards of all splits",
                "encodingFormat": PARQUET,
                "includes": "*.parquet",
            },
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "views",
                "name": "views",
                "description": "a record for each view; 'split' tells which it belongs to",
                "field": [_field(one) for one in fields],
            }
        ],
    }


def _field(one: Field) -> dict[str, Any]:
    about = {"isArray": True, "arrayShape": ",".join(map(str, one.shape))} if one.shape else {}
    return {
        "@type": "cr:Field",
        "@id": f"views/{one.name}",
        "name": one.name,
        "description": one.meaning if one.unit == "1" else f"{one.meaning} [{one.unit}]",
        "dataType": ["cr:Split", "sc:Text"] if one.name == "split" else _TYPES[one.kind],
        "source": {"fileSet": {"@id": "shards"}, "extract": {"column": one.name}},
        **about,
    }


def _address(licence: str) -> str:
    return licence if "://" in licence else f"https://spdx.org/licenses/{licence}.html"
