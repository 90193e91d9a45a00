"""Version 1: machines, entries, figures, files."""

import sqlalchemy as sa
from alembic import op

revision = "1"
down_revision = None


def upgrade() -> None:
    """Make the tables."""
    op.create_table(
        "machine",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("name", sa.String, nullable=False, unique=True),
        sa.Column("chain", sa.String, nullable=False),
        sa.Column("chain_hash", sa.String, nullable=False),
    )
    texts = ("kind", "at", "entered_at", "title", "method", "made_by")
    op.create_table(
        "entry",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("machine_id", sa.Integer, sa.ForeignKey("machine.id"), nullable=False),
        *(sa.Column(name, sa.String, nullable=False) for name in texts),
        sa.Column("document", sa.LargeBinary),
        sa.Column("fingerprint", sa.String, nullable=False),
    )
    op.create_index("entry_of_machine", "entry", ["machine_id", "at"])
    op.create_index("entry_of_time", "entry", ["entered_at"])
    op.create_table(
        "figure",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("entry_id", sa.Integer, sa.ForeignKey("entry.id"), nullable=False, index=True),
        sa.Column("name", sa.String, nullable=False),
        sa.Column("unit", sa.String, nullable=False),
        sa.Column("value", sa.Double, nullable=False),
        sa.Column("u", sa.Double, nullable=False),
    )
    op.create_index("figure_of_name", "figure", ["name", "entry_id"])
    op.create_table(
        "file",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("entry_id", sa.Integer, sa.ForeignKey("entry.id"), nullable=False, index=True),
        sa.Column("path", sa.String, nullable=False),
        sa.Column("fingerprint", sa.String, nullable=False),
    )
