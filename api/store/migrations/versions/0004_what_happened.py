"""What happened in a flight, told before models are fitted."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Add the sentence; analyses of earlier versions have none."""
    op.add_column("analyses", sa.Column("happened", sa.String(300)))
