"""The first tables."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Make logs, analyses (the queue), tokens and shares."""
    op.create_table(
        "logs",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("owner", sa.String(100), nullable=False),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("size", sa.BigInteger, nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("received", sa.DateTime, nullable=False),
        sa.Column("delete_digest", sa.String(64), nullable=False),
        sa.UniqueConstraint("owner", "sha256", name="uq_logs_owner_sha256"),
    )
    op.create_index("ix_logs_received", "logs", ["received"])
    op.create_table(
        "analyses",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("owner", sa.String(100), nullable=False),
        sa.Column("configuration", sa.JSON, nullable=False),
        sa.Column("state", sa.String(10), nullable=False),
        sa.Column("stage", sa.String(100), nullable=False),
        sa.Column("progress", sa.Double, nullable=False),
        sa.Column("attempts", sa.Integer, nullable=False),
        sa.Column("deaths", sa.Integer, nullable=False),
        sa.Column("created", sa.DateTime, nullable=False),
        sa.Column("started", sa.DateTime),
        sa.Column("ended", sa.DateTime),
        sa.Column("lease", sa.String(32)),
        sa.Column("lease_until", sa.DateTime),
        sa.Column("problem", sa.JSON),
        sa.Column("files", sa.JSON, nullable=False),
        sa.Column("results", sa.String(32)),
    )
    op.create_index("ix_analyses_queue", "analyses", ["state", "created"])
    op.create_index("ix_analyses_owner", "analyses", ["owner", "created"])
    op.create_table(
        "analysed_logs",
        sa.Column("analysis_id", sa.String(32), sa.ForeignKey("analyses.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("position", sa.Integer, primary_key=True),
        sa.Column("log_id", sa.String(32), sa.ForeignKey("logs.id"), nullable=False),
    )
    op.create_index("ix_analysed_logs_log_id", "analysed_logs", ["log_id"])
    op.create_table(
        "tokens",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("digest", sa.String(64), nullable=False, unique=True),
        sa.Column("owner", sa.String(100), nullable=False),
        sa.Column("created", sa.DateTime, nullable=False),
        sa.Column("expires", sa.DateTime),
    )
    op.create_index("ix_tokens_owner", "tokens", ["owner"])
    op.create_table(
        "shares",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("digest", sa.String(64), nullable=False, unique=True),
        sa.Column("analysis_id", sa.String(32), sa.ForeignKey("analyses.id", ondelete="CASCADE"), nullable=False),
        sa.Column("created", sa.DateTime, nullable=False),
        sa.Column("expires", sa.DateTime),
    )
    op.create_index("ix_shares_analysis_id", "shares", ["analysis_id"])
