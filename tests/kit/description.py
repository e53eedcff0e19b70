"""The description of the interfaces (OpenAPI) as the code makes it."""

from __future__ import annotations

import functools

from wonderland_backend.description import openapi
from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings


@functools.cache
def document():
    """Made once: it takes a second. Whoever asks does not change it."""
    return openapi(new_app(Settings(), frozenset(), None))
