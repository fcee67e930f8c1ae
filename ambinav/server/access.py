"""Access to the server: its names, origins of requests, tokens for reading and for editing."""

from __future__ import annotations

import hmac
import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple
from urllib.parse import SplitResult, urlsplit

from ambinav.runtime.errors import InputError

LOOPBACK: Final = ("127.0.0.1", "localhost", "::1")
"""Names of this machine to itself."""
PROBES: Final = ("/v1/health", "/v1/startup", "/v1/ready")
"""Paths for whoever watches the server, which addresses it by any name."""
OPEN_PATHS: Final = (*PROBES, "/openapi.json", "/docs")
"""Paths that reveal nothing about a map: they need no token."""

_EDITING: Final = re.compile(r"/v1/(audits|maps/[^/]+/(edits|sessions))(/|$)")
_READING: Final = ("GET", "HEAD", "OPTIONS")


class Refusal(NamedTuple):
    """A reason to refuse a request before its body is read.

    Attributes:
        status: The HTTP status.
        detail: The reason and the remedy in a sentence.
        headers: Further headers of the answer.
    """

    status: int
    detail: str
    headers: Mapping[str, str]


@dataclass(frozen=True)
class Access:
    """Names of the server and rights of its users.

    Where the server listens to this machine alone, another name in `Host` means that a page of
    another site was made to resolve to it. An address in numbers cannot be such a name.

    Attributes:
        token: Token for reading and editing; None with no `read_token`: everyone may.
        read_token: Token for everything except edits and audits; without `token`, nobody edits.
        hosts: Names that the server is addressed by.
        any_address: Whether every IP address is such a name too.
        public_url: Address under which users open the page, if a proxy has another one.

    Raises:
        InputError: the public address is none, or both tokens are the same.
    """

    token: str | None = None
    read_token: str | None = None
    hosts: tuple[str, ...] = LOOPBACK
    any_address: bool = False
    public_url: str | None = None

    def __post_init__(self) -> None:
        if self.public_url is not None:
            parts = _split(self.public_url)
            if (
                parts is None
                or parts.scheme not in ("http", "https")
                or not parts.hostname
                or parts.query
                or parts.fragment
            ):
                raise InputError(
                    f"--public-url: {self.public_url!r} is not the address of a page; give e.g. "
                    "https://maps.example.org/ambinav."
                )
        for host in self.hosts:
            parts = _split(f"//{host}" if host.count(":") < 2 else f"//[{host}]")
            if parts is None or not parts.hostname or parts.port is not None or parts.path:
                raise InputError(
                    f"--allowed-host: {host!r} is not a host name; give it without scheme, port "
                    "and path, e.g. maps.example.org."
                )
        if self.token is not None and self.token == self.read_token:
            raise InputError("--read-token: it is the same as --token; give another one.")

    @property
    def is_open(self) -> bool:
        """True if no token is required."""
        return self.token is None and self.read_token is None

    @cached_property
    def prefix(self) -> str:
        """Path in front of all addresses in the public address, such as "/ambinav", or ""."""
        return "" if self.public_url is None else urlsplit(self.public_url).path.rstrip("/")

    @cached_property
    def _names(self) -> frozenset[str]:
        public = urlsplit(self.public_url or "").hostname
        return frozenset(name.lower() for name in (*self.hosts, *([public] if public else [])))

    def refusal(self, method: str, path: str, headers: Mapping[bytes, bytes]) -> Refusal | None:
        """Return the reason to refuse a request; None if it may pass.

        Args:
            method: HTTP method.
            path: Path without `prefix`.
            headers: Headers by their names in lower case.
        """
        host = headers.get(b"host", b"").decode("latin-1")
        if path not in PROBES and not self._is_name(host):
            return Refusal(
                403,
                f"This server is not called {host[:200]!r}; use {self.hosts[0]}, or start it with "
                "--allowed-host.",
                {},
            )
        origin = headers.get(b"origin")
        if origin is not None and not self._is_ours(origin.decode("latin-1"), host):
            return Refusal(403, "Requests from pages of other sites are refused.", {})
        if self.is_open or path in OPEN_PATHS or not path.startswith("/v1"):
            return None
        authorization = headers.get(b"authorization", b"")
        may_edit, may_read = (
            _matches(authorization, token) for token in (self.token, self.read_token)
        )
        if not may_edit and not may_read:
            return Refusal(
                401,
                "The token is missing or wrong; send the header `Authorization: Bearer TOKEN`.",
                {"www-authenticate": "Bearer"},
            )
        if not may_edit and method not in _READING and _EDITING.match(path):
            remedy = (
                "this server takes no edits" if self.token is None else "send the token for editing"
            )
            return Refusal(403, f"The token is for reading only; {remedy}.", {})
        return None

    def _is_name(self, host: str) -> bool:
        parts = _split(f"//{host}")
        name = "" if parts is None else (parts.hostname or "").rstrip(".")
        if name in self._names:
            return True
        if not self.any_address:
            return False
        try:
            ipaddress.ip_address(name.partition("%")[0])
        except ValueError:
            return False
        return True

    def _is_ours(self, origin: str, host: str) -> bool:
        """Return whether a page of an origin is this server's own, as a browser opened it."""
        parts = _split(origin)
        if parts is None or not parts.netloc:
            return False
        public = None if self.public_url is None else urlsplit(self.public_url)
        return parts.netloc == host or (
            public is not None and (parts.scheme, parts.netloc) == (public.scheme, public.netloc)
        )


def _split(address: str) -> SplitResult | None:
    try:
        parts = urlsplit(address)
        parts.port  # noqa: B018, raises ValueError if it is no number
    except ValueError:
        return None
    return parts


def _matches(authorization: bytes, token: str | None) -> bool:
    return token is not None and hmac.compare_digest(authorization, f"Bearer {token}".encode())
