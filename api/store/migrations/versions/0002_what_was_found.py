"""What an analysis found, in short, for the list."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add craft, day of flight and health to analyses; those of earlier versions have none."""
    for column in (
        sa.Column("craft", sa.String(200)),
        sa.Column("flown", sa.String(10)),
        sa.Column("health", sa.String(40)),
        sa.Column("tone", sa.String(10)),
    ):
        op.add_column("analyses", column)
