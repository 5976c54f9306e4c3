"""Alerts as an Atom feed (RFC 4287), for readers of feeds; its address holds a secret in place of a token."""

from collections.abc import Sequence
from datetime import UTC, datetime
from xml.etree import ElementTree

from sqlalchemy import delete, select

from api.crafts.resources import RaisedAlert
from api.store.database import Database
from api.store.ids import digest, new_id, new_secret
from api.store.records import HookRecord

MEDIA_TYPE = "application/atom+xml"

_ATOM = "http://www.w3.org/2005/Atom"


class Feeds:
    """Secrets of feeds; the database has only their digests."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(self, owner: str) -> str:
        """Make the secret of an owner's feed; an earlier one is worthless from now on."""
        secret = new_secret()
        with self._database.write() as session:
            session.execute(delete(HookRecord).where(HookRecord.owner == owner, HookRecord.url == ""))
            session.add(
                HookRecord(id=new_id(), owner=owner, url="", secret=digest(secret), created=datetime.now(UTC), state="")
            )
        return secret

    def owner_of(self, secret: str) -> str | None:
        """Report whose feed a secret opens; None when it opens none."""
        with self._database.read() as session:
            return session.scalar(
                select(HookRecord.owner).where(HookRecord.secret == digest(secret), HookRecord.url == "")
            )


def atom(alerts: Sequence[RaisedAlert], base: str) -> bytes:
    """Write alerts as a feed; `base` is the address of the service."""
    ElementTree.register_namespace("", _ATOM)
    feed = ElementTree.Element(f"{{{_ATOM}}}feed")
    _add(feed, "id", f"{base}/crafts")
    _add(feed, "title", "rotorid: alerts")
    _add(feed, "updated", _time(max((each.created for each in alerts), default=datetime(1970, 1, 1, tzinfo=UTC))))
    _add(feed, "link", "", href=f"{base}/crafts")
    _add(_add(feed, "author", ""), "name", "rotorid")
    for alert in alerts:
        entry = _add(feed, "entry", "")
        _add(
            entry, "id", f"urn:uuid:{alert.id[:8]}-{alert.id[8:12]}-{alert.id[12:16]}-{alert.id[16:20]}-{alert.id[20:]}"
        )
        _add(entry, "title", _printable(f"{alert.name}: {alert.kind.replace('-', ' ')} ({alert.flight})"))
        _add(entry, "updated", _time(alert.created))
        _add(entry, "link", "", href=f"{base}/crafts/{alert.craft}")
        _add(entry, "category", "", term=alert.kind)
        _add(entry, "summary", _printable(alert.text))
    return bytes(ElementTree.tostring(feed, encoding="utf-8", xml_declaration=True))


def _add(parent: ElementTree.Element, name: str, text: str, **attributes: str) -> ElementTree.Element:
    element = ElementTree.SubElement(parent, f"{{{_ATOM}}}{name}", attributes)
    element.text = text or None
    return element


def _time(when: datetime) -> str:
    return when.astimezone(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def _printable(text: str) -> str:
    """Leave out what XML 1.0 cannot hold."""
    return "".join(each for each in text if each in "\t\n" or (each >= " " and each not in "\ufffe\uffff"))
