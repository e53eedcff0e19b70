"""signing: people's keys, transactions on their way, certificates seen on the chain

Certificates are noted as they act from now on; `wonderland backend rebuild` adds those of the past.
"""

import sqlalchemy as sa

from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "certificates",
        sa.Column("certificate_sha256", sa.String(length=64), nullable=False),
        sa.Column("msp_id", sa.String(length=128), nullable=False),
        sa.Column("name", sa.String(length=128), nullable=False),
        sa.Column("node_ou", sa.String(length=16), nullable=False),
        sa.Column("role", sa.String(length=128), nullable=False),
        sa.Column("pol_id", sa.String(length=128), nullable=False),
        sa.Column("serial", sa.String(length=64), nullable=False),
        sa.Column("not_before_ms", sa.BigInteger(), nullable=False),
        sa.Column("not_after_ms", sa.BigInteger(), nullable=False),
        sa.Column("block", sa.BigInteger(), nullable=False),
        sa.Column("tx_index", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("certificate_sha256", name=op.f("pk_certificates")),
    )
    op.create_index(op.f("ix_certificates_msp_id_name"), "certificates", ["msp_id", "name"])
    op.create_index(op.f("ix_certificates_not_after_ms"), "certificates", ["not_after_ms"])
    op.create_table(
        "signing_keys",
        sa.Column("certificate_sha256", sa.String(length=64), nullable=False),
        sa.Column("person_id", sa.String(length=32), nullable=False),
        sa.Column("msp_id", sa.String(length=128), nullable=False),
        sa.Column("name", sa.String(length=128), nullable=False),
        sa.Column("role", sa.String(length=128), nullable=False),
        sa.Column("not_after_ms", sa.BigInteger(), nullable=False),
        sa.Column("certificate", sa.Text(), nullable=False),
        sa.Column("bound_ms", sa.BigInteger(), nullable=False),
        sa.Column("ended_ms", sa.BigInteger(), nullable=True),
        sa.ForeignKeyConstraint(
            ["person_id"], ["people.person_id"], name=op.f("fk_signing_keys_person_id_people"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("certificate_sha256", name=op.f("pk_signing_keys")),
    )
    op.create_index(op.f("ix_signing_keys_person_id"), "signing_keys", ["person_id"])
    op.create_table(
        "signed_transactions",
        sa.Column("tx_id", sa.String(length=64), nullable=False),
        sa.Column("person_id", sa.String(length=32), nullable=False),
        sa.Column("person", sa.String(length=128), nullable=False),
        sa.Column("certificate_sha256", sa.String(length=64), nullable=False),
        sa.Column("function", sa.String(length=32), nullable=False),
        sa.Column("subject", sa.String(length=256), nullable=False),
        sa.Column("argument", sa.Text(), nullable=False),
        sa.Column("seen_block", sa.BigInteger(), nullable=True),
        sa.Column("seen_tx_index", sa.BigInteger(), nullable=True),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("proposal", sa.LargeBinary(), nullable=False),
        sa.Column("transaction", sa.LargeBinary(), nullable=True),
        sa.Column("endorsers", sa.Text(), nullable=False),
        sa.Column("block", sa.BigInteger(), nullable=True),
        sa.Column("validation", sa.String(length=40), nullable=True),
        sa.Column("problem", sa.Text(), nullable=True),
        sa.Column("created_ms", sa.BigInteger(), nullable=False),
        sa.Column("changed_ms", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("tx_id", name=op.f("pk_signed_transactions")),
    )
    op.create_index(
        op.f("ix_signed_transactions_person_id_created_ms"), "signed_transactions", ["person_id", "created_ms"]
    )
    op.create_index(op.f("ix_signed_transactions_state_changed_ms"), "signed_transactions", ["state", "changed_ms"])


def downgrade() -> None:
    for table in ("signed_transactions", "signing_keys", "certificates"):
        op.drop_table(table)
