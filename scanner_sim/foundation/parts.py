"""What every part of a scenario is: a frozen, self-checking description."""

from __future__ import annotations

import ast
import difflib
import inspect
import os
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Self, cast

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Strict,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from scanner_sim.foundation.errors import Fault, printable

Switch = Annotated[bool, Strict()]
"""True or false; ``yes``, ``off`` and 1 are not understood, because readers of YAML disagree about them."""
Count = Annotated[int, Strict()]
"""A whole number; ``"5"`` and 5.0 are not understood."""
Number = Annotated[float, Strict()]
"""A plain number without a unit."""


class Part(BaseModel):
    """A part of the bench or of the scenario: frozen, closed against unknown keys, finite numbers only."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        validate_default=False,
    )

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Describe keys by the texts below them. Pydantic can, but reads all sources whenever the package is loaded."""
        found = handler(schema)
        properties = handler.resolve_ref_schema(found)["properties"]
        for part in reversed([base for base in cls.__mro__ if issubclass(base, Part)]):
            for name, text in _texts(part):
                if field := part.model_fields.get(name):
                    properties[field.alias or name]["description"] = text
        return found

    def cross_checks(self) -> Iterator[Fault]:
        """Yield what is impossible about the values together; locations are relative to this part."""
        return iter(())

    def changed(self, **changes: Any) -> Self:
        """Return a copy with other values by their keys in files, which are not checked.

        A mapping changes values of a part within it, and nothing where there is ``none``.
        """
        names = {field.alias: name for name, field in type(self).model_fields.items() if field.alias}
        update = {}
        for key, value in changes.items():
            own = getattr(self, name := names.get(key, key))
            if isinstance(value, Mapping) and own == "none":
                continue
            nested = isinstance(own, Part) and isinstance(value, Mapping)
            update[name] = own.changed(**value) if nested else value
        return self.model_copy(update=update)

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        found = tuple(self.cross_checks())
        if found:
            text = printable("; ".join(str(fault) for fault in found))
            raise PydanticCustomError("impossible", "{text}", {"text": text, "faults": found})
        return self


@cache
def _texts(part: type[Part]) -> tuple[tuple[str, str], ...]:
    """Return the fields of a class that have a text of their own, with it; a schema asks for most parts many times."""
    (tree,) = ast.parse(inspect.getsource(part)).body
    found = []
    for field, text in pairwise(cast(ast.ClassDef, tree).body):
        match field, text:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(said))):
                found.append((name, inspect.cleandoc(said)))
    return tuple(found)


@dataclass(frozen=True)
class InputFile:
    """A pydantic annotation: a path to a file that exists, made absolute.

    Relative paths count from the folder of the scenario (``context["folder"]``), or from the working folder
    where the scenario did not come from a file.

    Parameters
    ----------
    suffixes
        Kinds of file that are understood, as ``.ply``.
    """

    suffixes: tuple[str, ...]

    def validate(self, value: object, info: ValidationInfo) -> Path:
        """Return the absolute path of what a scenario holds; pydantic's entrance."""
        if not isinstance(value, str | Path) or "\0" in str(value) or not str(value):
            raise self._error(f"this is not the name of a file; write for example part{self.suffixes[0]}")
        folder = info.context.get("folder", "") if isinstance(info.context, dict) else ""
        path = Path(os.path.abspath(Path(folder, os.path.expanduser(value))))
        try:
            mode = path.stat().st_mode
        except (OSError, ValueError):
            raise self._error(f"there is no file {path}; {nearest_file(path, self.suffixes)}") from None
        if stat.S_ISDIR(mode):
            raise self._error(f"{path} is a folder, not a file; name the file in it")
        if not stat.S_ISREG(mode):
            raise self._error(f"{path} is a pipe or a device; name an ordinary file")
        if path.suffix.lower() not in self.suffixes:
            raise self._error(
                f"{path.name} is none of the kinds that are read here: {', '.join(self.suffixes)}"
            )
        if not os.access(path, os.R_OK):
            raise self._error(f"{path} may not be read; change its permissions")
        return path

    @staticmethod
    def _error(problem: str) -> PydanticCustomError:
        return PydanticCustomError("input_file", "{problem}", {"problem": printable(problem)})

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return core_schema.with_info_before_validator_function(
            self.validate,
            handler(source),
            serialization=core_schema.plain_serializer_function_ser_schema(
                lambda path: Path(path).as_posix(), when_used="json"
            ),
        )

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        # Without the endings a word such as ``none`` beside a file would be both of them.
        endings = "|".join(
            "".join(f"[{letter}{letter.upper()}]" for letter in suffix[1:]) for suffix in self.suffixes
        )
        return {**handler(schema), "pattern": rf"\.({endings})$"}


MeshFile = Annotated[
    Path,
    InputFile((".ply", ".obj", ".stl", ".glb", ".gltf", ".off", ".3mf", ".dae")),
    Field(examples=["meshes/part.ply"]),
]
XmlFile = Annotated[Path, InputFile((".xml",)), Field(examples=["scenes/module.xml"])]


def nearest_file(path: Path, suffixes: tuple[str, ...]) -> str:
    """Say which file was probably meant by a path that leads nowhere."""
    folder = path.parent
    try:
        names = sorted(entry.name for entry in folder.iterdir() if entry.suffix.lower() in suffixes)
    except (FileNotFoundError, NotADirectoryError):
        return f"its folder {folder} does not exist either; paths count from the scenario's folder"
    except (OSError, ValueError):
        names = []
    near = difflib.get_close_matches(path.name, names, n=1, cutoff=0.5)
    return f"did you mean {near[0]}?" if near else "paths count from the scenario's folder"
