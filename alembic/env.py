"""Runs migrations on the connection that `wonderland_backend.db.migrate` hands over."""

from sqlalchemy import Connection, engine_from_config, pool

from alembic import context
from wonderland_backend.db.engine import parse_url
from wonderland_backend.db.partitions import is_partition
from wonderland_backend.db.tables import Base


def run(connection: Connection) -> None:
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        render_as_batch=connection.dialect.name == "sqlite",
        transaction_per_migration=False,
        compare_type=True,
        include_name=lambda name, kind, _parents: kind != "table" or not is_partition(name or ""),
    )
    with context.begin_transaction():
        context.run_migrations()


given = context.config.attributes.get("connection")
if given is not None:
    run(given)
else:
    # `alembic -x database=URL revision --autogenerate`, for whoever writes a migration.
    url = parse_url(context.get_x_argument(as_dictionary=True)["database"])
    synchronous = url.set(drivername=url.drivername.replace("+aiosqlite", ""))
    engine = engine_from_config(
        {"url": synchronous.render_as_string(hide_password=False)}, prefix="", poolclass=pool.NullPool
    )
    with engine.connect() as connection:
        run(connection)
