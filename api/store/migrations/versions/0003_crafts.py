"""Craft, their flights, notes and alerts."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def _craft() -> sa.Column[str]:
    return sa.Column("craft_id", sa.String(32), sa.ForeignKey("crafts.id", ondelete="CASCADE"), nullable=False)


def upgrade() -> None:
    """Make the tables; analyses of earlier versions have no flights until they are analysed again."""
    op.add_column("analyses", sa.Column("craft_id", sa.String(32)))
    op.add_column("analyses", sa.Column("trust", sa.String(10)))
    op.create_index("ix_analyses_craft", "analyses", ["craft_id"])
    op.create_index("ix_analyses_turn", "analyses", ["owner", "started"])
    op.create_table(
        "crafts",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("owner", sa.String(100), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("kind", sa.String(200), nullable=False),
        sa.Column("created", sa.DateTime, nullable=False),
        sa.Column("changed", sa.DateTime, nullable=False),
        sa.Column("revision", sa.Integer, nullable=False),
        sa.Column("reviewed", sa.Integer, nullable=False),
        sa.Column("review", sa.JSON),
        sa.Column("joint_of", sa.JSON, nullable=False),
        sa.Column("joint_lost", sa.String(300), nullable=False),
    )
    op.create_index("ix_crafts_owner", "crafts", ["owner", "changed"])
    op.create_table(
        "craft_keys",
        sa.Column("owner", sa.String(100), primary_key=True),
        sa.Column("digest", sa.String(64), primary_key=True),
        _craft(),
    )
    op.create_index("ix_craft_keys_craft_id", "craft_keys", ["craft_id"])
    op.create_table(
        "flights",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("owner", sa.String(100), nullable=False),
        _craft(),
        sa.Column("source", sa.String(64), nullable=False),
        sa.Column("number", sa.Integer, nullable=False),
        sa.Column("log_id", sa.String(32), sa.ForeignKey("logs.id", ondelete="CASCADE")),
        sa.Column("analysis_id", sa.String(32), sa.ForeignKey("analyses.id", ondelete="CASCADE")),
        sa.Column("folder", sa.String(400), nullable=False),
        sa.Column("name", sa.String(200), nullable=False),
        sa.Column("start", sa.DateTime),
        sa.Column("added", sa.DateTime, nullable=False),
        sa.Column("entry", sa.JSON, nullable=False),
        sa.Column("answers", sa.JSON, nullable=False),
        sa.Column("trust", sa.String(10), nullable=False),
        sa.UniqueConstraint("owner", "source", "number", name="uq_flights_source"),
    )
    for column in ("craft_id", "log_id", "analysis_id"):
        op.create_index(f"ix_flights_{column}", "flights", [column])
    op.create_table(
        "notes",
        sa.Column("id", sa.String(32), primary_key=True),
        _craft(),
        sa.Column("at", sa.DateTime, nullable=False),
        sa.Column("text", sa.String(500), nullable=False),
        sa.Column("boundary", sa.Boolean, nullable=False),
        sa.Column("created", sa.DateTime, nullable=False),
    )
    op.create_index("ix_notes_craft_id", "notes", ["craft_id"])
    op.create_table(
        "alerts",
        sa.Column("id", sa.String(32), primary_key=True),
        _craft(),
        sa.Column("about", sa.String(64), nullable=False),
        sa.Column("kind", sa.String(60), nullable=False),
        sa.Column("severity", sa.String(10), nullable=False),
        sa.Column("text", sa.String(2000), nullable=False),
        sa.Column("flight", sa.String(200), nullable=False),
        sa.Column("created", sa.DateTime, nullable=False),
        sa.UniqueConstraint("craft_id", "about", name="uq_alerts_about"),
    )
    op.create_index("ix_alerts_craft_id", "alerts", ["craft_id"])
    op.create_index("ix_alerts_created", "alerts", ["created"])
    op.create_table(
        "hooks",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("owner", sa.String(100), nullable=False),
        sa.Column("url", sa.String(500), nullable=False),
        sa.Column("secret", sa.String(100), nullable=False),
        sa.Column("created", sa.DateTime, nullable=False),
        sa.Column("state", sa.String(300), nullable=False),
    )
    op.create_index("ix_hooks_owner", "hooks", ["owner"])
    op.create_table(
        "deliveries",
        sa.Column("alert_id", sa.String(32), sa.ForeignKey("alerts.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("hook_id", sa.String(32), sa.ForeignKey("hooks.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("attempts", sa.Integer, nullable=False),
        sa.Column("due", sa.DateTime, nullable=False),
    )
    op.create_index("ix_deliveries_due", "deliveries", ["due"])
