"""A database password that nobody thought of; and the health of a backend that is not there."""

import stat

from click.testing import CliRunner

from wonderland_backend.commands import backend
from wonderland_backend.db import passwords


def test_it_is_made_once_in_the_two_forms_in_which_it_is_read(tmp_path):
    at = tmp_path / "secrets"
    directory = at / "owner"
    first = CliRunner().invoke(backend, ["new-password", "--to", str(at)])
    assert first.exit_code == 0
    assert "new passwords" in first.output
    password = (directory / passwords.FOR_SERVER).read_text()
    assert len(password.strip()) >= 40
    assert (directory / passwords.FOR_CLIENT).read_text() == f"*:*:*:wonderland:{password}"
    assert password.strip() not in first.output
    assert stat.S_IMODE((directory / passwords.FOR_CLIENT).stat().st_mode) == 0o600
    assert stat.S_IMODE((directory / passwords.FOR_SERVER).stat().st_mode) == 0o640
    assert "they stay" in CliRunner().invoke(backend, ["new-password", "--to", str(at)]).output
    assert (directory / passwords.FOR_SERVER).read_text() == password
    servers = (at / "server" / passwords.FOR_SERVER).read_text()
    assert servers != password
    assert (at / "server" / passwords.FOR_CLIENT).read_text() == f"*:*:*:wonderland_server:{servers}"


def test_a_lost_client_file_is_made_from_the_servers(tmp_path):
    passwords.ensure(tmp_path, "me", "secret")
    (tmp_path / passwords.FOR_CLIENT).unlink()
    assert passwords.ensure(tmp_path, "me", "other") is False
    assert (tmp_path / passwords.FOR_CLIENT).read_text() == "*:*:*:me:secret\n"


def test_a_backend_that_is_not_there_is_not_healthy():
    answer = CliRunner().invoke(backend, ["health", "--at", "http://127.0.0.1:1"])
    assert answer.exit_code == 1
    assert "no backend answers at http://127.0.0.1:1" in answer.output
    assert CliRunner().invoke(backend, ["health", "--at", "127.0.0.1:1"]).exit_code == 2
