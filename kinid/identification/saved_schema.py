"""What a saved fit or diagnosis holds, field by field, with what its numbers can be."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from kinid.errors import InputError
from kinid.writers import Json

Number = Annotated[float, Field(allow_inf_nan=False)]
#: of forces, moments and times; nothing measured is larger in its unit
Size = Annotated[float, Field(ge=0.0, le=1e12)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Unit = Literal["N", "N·m"]
Facts = TypeVar("Facts", bound="SavedFacts")


class SavedFacts(BaseModel):
    """A table of JSON: types as they stand, and room for what a later version adds."""

    model_config = ConfigDict(strict=True, extra="allow")


class Errors(SavedFacts):
    """Of a fit: seen, held out, and what noise alone explains; null where there is no figure."""

    unit: Unit
    train: Size | None
    held_out: Size | None
    noise_floor: Size | None


class SavedFit(SavedFacts):
    """Of `fit.save` and `kinid fit --json`; parameters are looked at one by one, with the model's own limits."""

    model: list[str]
    parameters: dict[str, dict[str, object]]
    error: Errors
    warnings: list[str] = []
    rest: dict[str, bool | Size] = {}


def checked(facts: Json, kind: type[Facts], path: Path, what: str, mend: str) -> Facts:
    """The facts, if they are of this kind.

    Raises:
        InputError: a field that is missing or of another type, or a number that can't be.
    """
    try:
        return kind.model_validate(facts)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        found = "nothing" if first["type"] == "missing" else str(first["input"])[:40]
        says = first["msg"][0].lower() + first["msg"][1:]
        where = f" for {place}" if place else ""
        raise InputError(f"{found}{where} in {path} ({says})", what, mend) from None
