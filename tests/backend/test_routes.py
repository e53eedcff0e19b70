"""The application as an object."""

import gc
import weakref
from pathlib import Path

from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings


def test_nothing_holds_an_application_that_is_no_longer_used():
    app = new_app(Settings(), allowed_hosts=frozenset({"127.0.0.1"}), console_directory=Path("/nowhere"))
    left = weakref.ref(app)
    del app
    gc.collect()
    assert left() is None
