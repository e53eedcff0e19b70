"""Backends of one process share their routes: FastAPI takes longer to derive what it needs of 130 than most tests take."""

from __future__ import annotations

import copy

import pytest
from pydantic import BaseModel
from starlette.datastructures import State

from wonderland_backend import app as backend_app
from wonderland_backend.description import openapi
from wonderland_backend.routes import new_app


class _Noted:
    """Settings that note what was asked of them."""

    def __init__(self, settings, asked, path=()):
        self._settings, self._asked, self._path = settings, asked, path

    def __getattr__(self, name):
        value, path = getattr(self._settings, name), (*self._path, name)
        if isinstance(value, BaseModel):
            return _Noted(value, self._asked, path)
        self._asked[path] = value
        return value


def _answer(settings, path):
    for name in path:
        settings = getattr(settings, name)
    return settings


class SharedRoutes:
    """Makes applications like `new_app`: those that would have the same routes have the very same."""

    def __init__(self):
        self._made = []

    def __call__(self, settings, allowed_hosts, console_directory):
        where = (allowed_hosts, console_directory)
        for made_where, asked, pattern in self._made:
            if made_where == where and all(_answer(settings, path) == value for path, value in asked.items()):
                return self._like(pattern)
        asked = {}
        pattern = new_app(_Noted(settings, asked), allowed_hosts, console_directory)
        self._made.append((where, asked, pattern))
        return self._like(pattern)

    @staticmethod
    def _like(pattern):
        app = copy.copy(pattern)
        app.state = State()
        app.user_middleware = list(pattern.user_middleware)
        app.exception_handlers = dict(pattern.exception_handlers)
        app.middleware_stack = app.openapi_schema = None
        app.openapi = lambda: openapi(app)
        return app


@pytest.fixture(scope="session", autouse=True)
def _shared_routes():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(backend_app, "new_app", SharedRoutes())
        yield
