"""What is wrong with a field is said in the language of whoever sent it, and never with a library's prefix."""

from __future__ import annotations

from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, Field, TypeAdapter, ValidationError, model_validator
from pydantic_core import _pydantic_core

from wonderland.messages import facts_of, keys_of
from wonderland.problems import Said, said
from wonderland_backend.field_texts import KINDS, PREFIX, FieldRefused, field_text, first_error

THEIRS = {each["type"]: each.get("example_context") or {} for each in _pydantic_core.list_all_errors()}


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_one_of_pydantics_and_its_message_names_facts_that_there_are(kind):
    key = PREFIX + KINDS[kind]
    assert key in keys_of("problems")
    assert facts_of("problems", key) <= set(THEIRS[kind])


class Body(BaseModel, extra="forbid"):
    name: str = Field(default="aa", min_length=2, max_length=3, pattern="^[a-z]*$")
    count: int = Field(default=1, ge=1, lt=1_800_000_000_000)
    share: float = Field(default=0.5, gt=0.25, le=90.0, allow_inf_nan=False)
    kind: Literal["this", "that"] = "this"
    several: list[bool] = Field(default=[True], min_length=1, max_length=2)

    @model_validator(mode="after")
    def _both(self):
        if self.count == 7:
            raise FieldRefused(said("fields_note"))
        if self.count == 8:
            raise ValueError("their own words")
        return self


@pytest.mark.parametrize(
    ("body", "english", "finnish"),
    [
        ({"name": 5}, "must be a text", "pitää olla tekstiä"),
        ({"name": "a"}, "is too short; at least 2 characters are needed", "liian lyhyt; vähintään 2 merkkiä"),
        ({"name": "aaaa"}, "is too long; 3 characters are allowed", "liian pitkä; enintään 3 merkkiä"),
        ({"name": "A1"}, "does not have the form that is needed, ^[a-z]*$", "ei ole vaadittua muotoa ^[a-z]*$"),
        ({"count": 0}, "must be 1 or more", "pitää olla vähintään 1"),
        ({"count": 1_800_000_000_000}, "must be less than 1800000000000", "pitää olla pienempi kuin 1800000000000"),
        ({"count": "x"}, "must be a whole number", "pitää olla kokonaisluku"),
        ({"count": 1.5}, "must be a whole number", "pitää olla kokonaisluku"),
        ({"share": 0.25}, "must be greater than 0.25", "pitää olla suurempi kuin 0.25"),
        ({"share": 90.5}, "must be 90 or less", "pitää olla enintään 90"),
        ({"share": float("nan")}, "must be a finite number", "pitää olla äärellinen luku"),
        ({"kind": "other"}, "must be one of 'this', 'that'", "pitää olla jokin näistä: 'this', 'that'"),
        ({"several": []}, "has too few entries; at least one is needed", "liian vähän alkioita; tarvitaan vähintään 1"),
        (
            {"several": [True] * 3},
            "has too many entries; 2 are allowed",
            "liian monta alkiota; sallittu määrä on enintään 2",
        ),
        ({"several": 1}, "must be a list", "pitää olla luettelo"),
        ({"several": ["?"]}, "must be true or false", "pitää olla true tai false"),
        ({"other": 1}, "is not known here", "ei ole tunnettu kenttä"),
        (7, "must be an object", "pitää olla objekti"),
        ({"count": 7}, "a note needs a text", "huomautus tarvitsee tekstin"),
    ],
)
def test_what_is_wrong_in_both_languages(body, english, finnish):
    with pytest.raises(ValidationError) as refused:
        Body.model_validate(body)
    text = field_text(refused.value.errors()[0])
    assert isinstance(text, Said)
    assert (text.text("en"), text.text("fi")) == (english, finnish)


def test_what_there_is_no_message_for_comes_without_pydantics_prefix():
    with pytest.raises(ValidationError) as refused:
        Body.model_validate({"count": 8})
    assert field_text(refused.value.errors()[0]) == "their own words"
    with pytest.raises(ValidationError) as refused:
        TypeAdapter(Annotated[bytes, Field(min_length=1)]).validate_python(5)
    assert field_text(refused.value.errors()[0]) == "Input should be a valid bytes"


def test_the_first_error_names_its_field():
    with pytest.raises(ValidationError) as refused:
        Body.model_validate({"several": [True, 5.5], "other": 1})
    assert str(first_error(refused.value.errors())) == "several.1: must be true or false"
