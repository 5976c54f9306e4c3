"""Webhooks: alerts sent to addresses of their owners' choice, and nowhere that only this service can reach.

Only https, and only to addresses of the public internet: a name is resolved once, all its addresses are looked at, and
the connection goes to the very address that was looked at, so that a name that changes its mind leads nowhere. Answers
are not read, redirects not followed, and who answers byte by byte is cut off: others wait for no one. An operator may
allow any address (``ROTORID_WEBHOOKS=any``) or none (``off``).
"""

import hashlib
import hmac
import http.client
import ipaddress
import json
import socket
import ssl
import threading
import unicodedata
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from http import HTTPStatus
from itertools import groupby
from typing import TypeAlias
from urllib.parse import urlsplit

from sqlalchemy import Row, delete, select, update

from api.problems import ProblemError
from api.settings import Webhooks
from api.store.database import Database
from api.store.ids import digest, new_id, new_secret
from api.store.records import AlertRecord, CraftRecord, DeliveryRecord, HookRecord
from api.work.rounds import Rounds

#: Seconds between two looks for alerts to send, and for an answer, from the connection on.
LOOK_EVERY, TIMEOUT = 2.0, 10.0

#: Hooks that are sent to at the same time, and alerts of one look.
_AT_ONCE, _OF_ONE_LOOK = 8, 100

#: Tries of one alert; after each the pause before the next doubles from this on.
_TRIES, _PAUSE = 8, timedelta(seconds=30)

#: Most hooks of one owner.
_MOST = 20

#: Where all public addresses of version 6 are.
_UNICAST = ipaddress.ip_network("2000::/3")

#: Addresses in it, and of version 4, that are nobody's, or lead to others: NAT64, documentation, relays.
_NOBODYS = tuple(ipaddress.ip_network(network) for network in ("64:ff9b::/96", "3fff::/20", "192.88.99.0/24"))

#: A delivery with what it is of.
_Due: TypeAlias = Row[DeliveryRecord, AlertRecord, CraftRecord, HookRecord]


class ForbiddenAddressError(Exception):
    """An address to which nothing is sent."""


def check_address(url: str, webhooks: Webhooks) -> None:
    """Refuse an address that a webhook may not have, as far as its name tells."""
    try:
        parts = urlsplit(url)
        port = parts.port
        (parts.hostname or "").encode("idna")
    except ValueError:
        raise ForbiddenAddressError("it is no address") from None
    if not all("!" <= letter <= "~" for letter in f"{parts.path}{parts.query}"):
        raise ForbiddenAddressError("its path must be of printable ASCII; write other characters as %XX")
    if webhooks is Webhooks.OFF:
        raise ForbiddenAddressError("this service sends no webhooks")
    allowed = ("https",) if webhooks is Webhooks.PUBLIC else ("https", "http")
    if parts.scheme not in allowed or not parts.hostname:
        raise ForbiddenAddressError(
            f"it must begin with {' or '.join(f'{scheme}://' for scheme in allowed)} and a name"
        )
    if parts.username is not None or parts.password is not None:
        raise ForbiddenAddressError("it must hold no user or password")
    if webhooks is Webhooks.PUBLIC and port not in (None, 443, 8443):
        raise ForbiddenAddressError("its port must be 443 or 8443")
    host = unicodedata.normalize("NFKC", parts.hostname)
    if webhooks is Webhooks.PUBLIC and (host == "localhost" or host.endswith(".localhost")):
        raise ForbiddenAddressError(f"{host} is this computer")
    try:
        literal = ipaddress.ip_address(host)
    except ValueError:
        try:  # 127.1, 0x7f000001 and the like are no names either
            literal = ipaddress.IPv4Address(socket.inet_aton(host))
        except (OSError, ValueError):
            return
    _check(literal, webhooks)


def _check(address: ipaddress.IPv4Address | ipaddress.IPv6Address, webhooks: Webhooks) -> None:
    if webhooks is Webhooks.ANY:
        return
    # Addresses that carry an IPv4 address in themselves lead to it.
    carried = getattr(address, "ipv4_mapped", None) or getattr(address, "sixtofour", None)
    outside = address.version == 6 and address not in _UNICAST
    nobodys = outside or any(address in network for network in _NOBODYS if network.version == address.version)
    teredo = getattr(address, "teredo", None)
    if carried is not None or teredo is not None or nobodys or not address.is_global or address.is_multicast:
        raise ForbiddenAddressError(f"{address} is no address of the public internet")


def resolve(host: str, port: int, webhooks: Webhooks) -> str:
    """Return the address that a name leads to, if none that it leads to is forbidden."""
    addresses = [str(entry[4][0]) for entry in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)]
    for address in addresses:
        _check(ipaddress.ip_address(address.partition("%")[0]), webhooks)
    return addresses[0]


def send(url: str, body: bytes, secret: str, webhooks: Webhooks, timeout: float = TIMEOUT) -> int:
    """Post a body and return the status of the answer."""
    check_address(url, webhooks)
    parts = urlsplit(url)
    secure = parts.scheme == "https"
    host, port = parts.hostname or "", parts.port or (443 if secure else 80)
    address = resolve(host, port, webhooks)
    stream = socket.create_connection((address, port), timeout=timeout)
    if secure:
        context = ssl.create_default_context()
        stream = context.wrap_socket(stream, server_hostname=host, do_handshake_on_connect=False)
    late = threading.Event()
    deadline = threading.Timer(timeout, _cut_off, (stream, late))
    deadline.start()
    try:
        if isinstance(stream, ssl.SSLSocket):
            stream.do_handshake()
        connection = http.client.HTTPConnection(host, port, timeout=timeout)
        connection.sock = stream
        signature = hmac.new(secret.encode(), body, hashlib.sha256).hexdigest()
        target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        connection.request(
            "POST",
            target,
            body,
            {
                "Content-Type": "application/json",
                "User-Agent": "rotorid",
                "Rotorid-Signature": f"sha256={signature}",
                "Connection": "close",
            },
        )
        return connection.getresponse().status
    except (OSError, http.client.HTTPException) as error:
        if late.is_set():  # what was cut off may end as it likes: by what came so far, or by a reset
            raise OSError(f"no HTTP answer within {timeout:g} s") from error
        if isinstance(error, OSError):
            raise
        raise OSError(f"no HTTP answer: {type(error).__name__}") from error
    finally:
        deadline.cancel()
        stream.close()


def _cut_off(stream: socket.socket, late: threading.Event) -> None:
    """End a connection that another thread waits for."""
    late.set()
    with suppress(OSError):
        socket.socket.shutdown(stream, socket.SHUT_RDWR)


class Hooks(Rounds):
    """The webhooks of all owners; what is due is sent by a thread of its own."""

    def __init__(self, database: Database, webhooks: Webhooks) -> None:
        super().__init__("webhooks", LOOK_EVERY)
        self._database = database
        self._webhooks = webhooks

    def open(self) -> None:
        """Start."""
        if self._webhooks is not Webhooks.OFF:
            super().open()

    def create(self, owner: str, url: str) -> HookRecord:
        """Add a hook; its secret is told once."""
        try:
            check_address(url, self._webhooks)
        except ForbiddenAddressError as error:
            detail = f"Nothing is sent to this address: {error}."
            raise ProblemError.of("forbidden-address", detail) from error
        with self._database.write() as session:
            owned = session.scalars(select(HookRecord).where(HookRecord.owner == owner, HookRecord.url != "")).all()
            if len(owned) >= _MOST:
                detail = f"There are {_MOST} webhooks, the most that one user may have. Remove one, then try again."
                raise ProblemError.of("too-many-hooks", detail)
            record = HookRecord(
                id=new_id(), owner=owner, url=url, secret=new_secret(), created=datetime.now(UTC), state=""
            )
            session.add(record)
        return record

    def list(self, owner: str) -> list[HookRecord]:
        """List the webhooks of an owner."""
        with self._database.read() as session:
            query = select(HookRecord).where(HookRecord.owner == owner, HookRecord.url != "")
            return list(session.scalars(query.order_by(HookRecord.created)))

    def remove(self, owner: str, hook_id: str) -> bool:
        """Remove a webhook; False when the owner has none of this id."""
        with self._database.write() as session:
            record = session.get(HookRecord, hook_id)
            if record is None or record.owner != owner:
                return False
            session.delete(record)
            return True

    def go_round(self) -> None:
        """Send what is due now."""
        self.deliver(datetime.now(UTC))

    def deliver(self, now: datetime) -> None:
        """Send what is due; each is taken before it is sent, so that no two servers send it."""
        with self._database.read() as session:
            due = session.execute(
                select(DeliveryRecord, AlertRecord, CraftRecord, HookRecord)
                .join(AlertRecord, AlertRecord.id == DeliveryRecord.alert_id)
                .join(CraftRecord, CraftRecord.id == AlertRecord.craft_id)
                .join(HookRecord, HookRecord.id == DeliveryRecord.hook_id)
                .where(DeliveryRecord.due <= now)
                .order_by(DeliveryRecord.due)
                .limit(_OF_ONE_LOOK)
            ).all()
        by_hook = groupby(sorted(due, key=lambda row: row[3].id), key=lambda row: row[3].id)
        rows = [list(own) for _, own in by_hook]
        with ThreadPoolExecutor(max_workers=_AT_ONCE, thread_name_prefix="webhook") as pool:
            list(pool.map(lambda own: self._send_all(own, now), rows))

    def _send_all(self, due: Sequence[_Due], now: datetime) -> None:
        """Send what is due to one hook; what is left when it does not take one waits as long as that one."""
        for delivery, alert, craft, hook in due:
            if self.closing or not self._take(delivery, now):
                continue
            body = {
                "alert": alert.id,
                "kind": alert.kind,
                "severity": alert.severity,
                "text": alert.text,
                "flight": alert.flight,
                "craft": {"id": craft.id, "name": craft.name or craft.kind},
                "created": alert.created.isoformat(),
            }
            try:
                status = send(hook.url, json.dumps(body).encode(), hook.secret, self._webhooks)
                said = "" if status < HTTPStatus.MULTIPLE_CHOICES else f"answered {status}"
            except (ForbiddenAddressError, OSError, ValueError) as error:
                said = str(error)[:200] or type(error).__name__
            self._note(delivery, f"{now:%Y-%m-%d %H:%M} UTC: {said or 'delivered'}", done=not said)
            if said:
                self._put_off(hook.id, now + _PAUSE * 2**delivery.attempts)
                return

    def _take(self, delivery: DeliveryRecord, now: datetime) -> bool:
        mine = (DeliveryRecord.alert_id == delivery.alert_id, DeliveryRecord.hook_id == delivery.hook_id)
        later = now + _PAUSE * 2**delivery.attempts
        with self._database.write() as session:
            record = session.scalar(select(DeliveryRecord).where(*mine, DeliveryRecord.attempts == delivery.attempts))
            if record is None:
                return False
            record.attempts += 1
            record.due = later
            return True

    def _put_off(self, hook_id: str, until: datetime) -> None:
        mine = (DeliveryRecord.hook_id == hook_id, DeliveryRecord.due < until)
        with self._database.write() as session:
            session.execute(update(DeliveryRecord).where(*mine).values(due=until))

    def _note(self, delivery: DeliveryRecord, said: str, *, done: bool) -> None:
        with self._database.write() as session:
            if done or delivery.attempts + 1 >= _TRIES:
                session.execute(
                    delete(DeliveryRecord).where(
                        DeliveryRecord.alert_id == delivery.alert_id, DeliveryRecord.hook_id == delivery.hook_id
                    )
                )
            session.execute(update(HookRecord).where(HookRecord.id == delivery.hook_id).values(state=said[:300]))


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
