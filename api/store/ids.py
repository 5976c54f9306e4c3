"""Names that nobody guesses: of logs and analyses, and secrets of which only a digest is kept."""

import hashlib
import re
import secrets

_ID = re.compile(r"[0-9a-f]{32}")


def new_id() -> str:
    """Draw an identifier, 32 hexadecimal digits."""
    return secrets.token_hex(16)


def is_id(text: str) -> bool:
    """Return whether a text could be one of our identifiers."""
    return _ID.fullmatch(text) is not None


def new_secret() -> str:
    """Draw a secret that fits into a URL, 256 bits."""
    return secrets.token_urlsafe(32)


def digest(secret: str) -> str:
    """Return what is kept of a secret; secrets are random and long, so that a plain SHA-256 cannot be turned back."""
    return hashlib.sha256(secret.encode()).hexdigest()
