"""What is printed for programs, held to the schemas beside the register tables."""

from __future__ import annotations

import functools
import json
from typing import Any

import jsonschema

from sniffer.ground.registers import schema_path


def hold_to(name: str, told: Any) -> None:
    """Hold a row, or all that was told, to ``schemas/<name>.schema.json``.

    Raises:
        ValidationError: it says another thing, or says it otherwise.
    """
    _schema(name).validate(told)


@functools.cache
def _schema(name: str) -> jsonschema.Draft202012Validator:
    """Return one that is a schema: to look at that anew for each row costs ten times the row."""
    schema = json.loads(schema_path(f"{name}.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)
