"""Settings of U-space from the environment and the command line."""

from __future__ import annotations

import pytest

from wonderland_backend.errors import SettingsError
from wonderland_backend.settings import load
from wonderland_backend.uspace.service import USpace

PREFIX = "WONDERLAND_BACKEND_USPACE__"


def test_the_environment_and_the_command_line_go_together(monkeypatch):
    monkeypatch.setenv(PREFIX + "DSS", '["https://dss.example"]')
    monkeypatch.setenv(PREFIX + "CLIENT_SECRET", "very secret")
    monkeypatch.setenv(PREFIX + "OPERATORS", '["FIN87astrdge12k8-xyz", "FIN87astrdge12k9"]')
    settings = load(uspace={"test_harness": True}).uspace
    assert (settings.test_harness, settings.dss) == (True, ("https://dss.example",))
    assert settings.operators == ("FIN87astrdge12k8", "FIN87astrdge12k9")
    assert "very secret" not in repr(settings)
    assert load().uspace.test_harness is False


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("DSS", '["ftp://dss.example"]', "DSS"),
        ("DSS", "[", "uspace"),
        ("ISSUERS", '[{"issuer": "a"}]', "jwks_url or keys_file"),
        ("ISSUERS", '[{"issuer": "a", "jwks_url": "https://a.example", "keys_file": "b"}]', "one of the two"),
        ("OPERATORS", '["FIN87astrdge12k8-abc"]', "check character"),
        ("SERVE", "everybody", "ours"),
        ("UNHEARD_OF", "1", "UNHEARD_OF"),
    ],
)
def test_settings_that_are_wrong_are_named(monkeypatch, name, value, words):
    monkeypatch.setenv(PREFIX + name, value)
    with pytest.raises(SettingsError, match=words) as refused:
        load()
    assert "abc" not in str(refused.value) or name != "OPERATORS"


def test_a_keys_file_that_is_none(monkeypatch, tmp_path):
    monkeypatch.setenv(PREFIX + "ISSUERS", f'[{{"issuer": "a", "keys_file": "{tmp_path / "none"}"}}]')
    with pytest.raises(SettingsError, match="issuers"):
        USpace(load(), lambda: 0)
