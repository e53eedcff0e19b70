"""A private PostgreSQL server for the tests of one process."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import tempfile
from pathlib import Path

import psycopg
import pytest
from sqlalchemy.engine import make_url

from kit.databases import make_tables


class Postgres:
    """A private PostgreSQL server, run as somebody other than root."""

    def __init__(self, programs, directory):
        self.programs = programs
        self.directory = directory
        self.user = "postgres" if os.geteuid() == 0 else None
        self.data = directory / "data"
        self.count = 0
        self.template = None

    def run(self, program, *arguments):
        command = [str(self.programs / program), *arguments]
        if self.user is not None:
            command = ["setpriv", f"--reuid={self.user}", f"--regid={self.user}", "--clear-groups", *command]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=self.directory)
        if done.returncode:
            raise RuntimeError(f"{program}: {done.stdout} {done.stderr}")

    def start(self):
        if self.user is not None:
            owner = pwd.getpwnam(self.user)
            os.chown(self.directory, owner.pw_uid, owner.pw_gid)
        self.run("initdb", "-D", str(self.data), "-U", "wonderland", "-A", "trust", "-E", "UTF8", "--no-sync")
        self.restart()

    def restart(self):
        # Without fsync a power failure would lose data, which no test makes; a server that is killed loses none.
        options = f"-c listen_addresses='' -c unix_socket_directories={self.directory} -c fsync=off"
        self.run("pg_ctl", "-D", str(self.data), "-w", "-l", str(self.directory / "log"), "-o", options, "start")

    def stop(self):
        self.run("pg_ctl", "-D", str(self.data), "-m", "immediate", "-w", "stop")

    def new_database(self, *, migrated=False):
        """The URL of a new database; a migrated one is a copy: migrating takes longer than most tests."""
        self.count += 1
        if migrated and self.template is None:
            self.template = self._create("template_migrated", "template1")
            make_tables(self.url(self.template))
        return self.url(self._create(f"test_{self.count}", self.template if migrated else "template1"))

    def drop(self, url):
        self._say(f"DROP DATABASE IF EXISTS {make_url(url).database} WITH (FORCE)")

    def _create(self, name, template):
        self._say(f"CREATE DATABASE {name} TEMPLATE {template} STRATEGY file_copy")
        return name

    def _say(self, statement):
        # By a connection, not by createdb: a program takes longer to start than the copy takes.
        with psycopg.connect(f"host={self.directory} user=wonderland dbname=postgres", autocommit=True) as connection:
            connection.execute(statement)

    def url(self, name):
        return f"postgresql://wonderland@/{name}?host={self.directory}"


@pytest.fixture(scope="session")
def postgres(request):
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    on_path = shutil.which("initdb")
    programs = found[-1].parent if found else Path(on_path).parent if on_path else None
    if programs is None:
        pytest.skip("PostgreSQL's server programs (initdb, pg_ctl) are not installed")
    if os.geteuid() == 0:
        try:
            pwd.getpwnam("postgres")
        except KeyError:
            pytest.skip("PostgreSQL refuses root, and there is no user postgres to run it as")
        if shutil.which("setpriv") is None:
            pytest.skip("PostgreSQL refuses root, and there is no setpriv to become another user")
    # Not below pytest's own directory, which only its owner may enter.
    with tempfile.TemporaryDirectory(prefix="wl-pg-") as directory:
        server = Postgres(programs, Path(directory))
        server.start()
        try:
            yield server
        finally:
            server.stop()
