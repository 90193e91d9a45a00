"""Version 2: the causes that diagnoses have found."""

import sqlalchemy as sa
from alembic import op

revision = "2"
down_revision = "1"


def upgrade() -> None:
    """Make the table of causes."""
    op.create_table(
        "cause",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("entry_id", sa.Integer, sa.ForeignKey("entry.id"), nullable=False, index=True),
        sa.Column("name", sa.String, nullable=False),
        sa.Column("verdict", sa.String, nullable=False),
        sa.Column("log10_odds", sa.Double, nullable=False),
        sa.Column("sizes", sa.JSON, nullable=False),
    )
