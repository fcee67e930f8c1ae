"""HTTP client of a served map, with the interface of `AmbiguityService`."""

from __future__ import annotations

import math
import tempfile
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import NoneType
from typing import Any, Final, Self, TypeVar, overload
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_flat, as_nonnegative, as_number, check_kind
from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import need
from ambinav.runtime.scalars import Scalar
from ambinav.server.wire import OCTETS, POSE_COLUMNS, STEP_COLUMNS, packed, read_map
from ambinav.service.service import AmbiguityService, Pose

T = TypeVar("T")

PIECE: Final = 100_000
"""Rows of a request; longer batches are sent in pieces."""
SECONDS: Final = 30.0
"""Until an answer has come; a map as a whole may take longer."""
PAUSE: Final = 0.1
"""Seconds until the first further attempt; each later pause is twice as long, up to `LONGEST`."""
LONGEST: Final = 5.0
BUSY: Final = (429, 502, 503, 504)
"""Statuses after which the same request may have better luck."""
CHANGED: Final = 412

_FETCHED: Final = ("map", "ambiguity", "graded", "density")
"""Attributes of a service that need the map's arrays."""


class ServerError(RuntimeError):
    """The server failed to answer, although the request was valid: it is gone, busy or faulty."""


class Client(AmbiguityService):
    """Cost and reward from a map served by `ambinav serve`.

    It can replace an `AmbiguityService` everywhere. Costs, levels and rewards of poses and motions
    are requested from the server, many in one request. The fields (`map`, `density` ...) and
    everything computed from them (gradients, costs of routes and of motions) need the map's arrays:
    they are downloaded on first use, and kept.

    Args:
        url: Address of the server, such as "http://127.0.0.1:8765".
        map: Id of the map; None: the only one that is served.
        token: Token of the server, if it has one.
        layer: Layer as in `AmbiguityService`, like the weight.
        weight: See there.
        patience: Seconds for which a request is repeated if the server cannot be reached or is
            busy, after the pauses that it asks for (`Retry-After`).

    All requests name the digest of the map (`If-Match`): if the server is started again with
    another map of this id, the client refuses it.

    Raises:
        InputError: there is no server at the address, the token is wrong, or the map or layer does
            not exist.
        ServerError: in later requests, if the server cannot be reached or has another map.

    Attributes:
        id: The map's id.
        info: Description of the map by the server.
    """

    def __init__(
        self,
        url: str,
        map: str | None = None,
        token: str | None = None,
        *,
        layer: str | None = None,
        weight: float = 5.0,
        patience: float = 30.0,
    ) -> None:
        if token is not None and not (token.isascii() and token.isprintable()):
            raise InputError("token has characters that no token has; give printable ASCII.")
        check_kind(url, str, "url", "give e.g. http://127.0.0.1:8765")
        check_kind(map, (str, NoneType), "map", "give the id of a map")
        as_number(patience, "patience")
        need("ambinav.Client", ("httpx",), "serve")
        import httpx

        self._errors = httpx.HTTPError, httpx.InvalidURL
        self._connection = url, token, patience
        self._match: dict[str, str] = {}
        headers = {} if token is None else {"authorization": f"Bearer {token}"}
        transport = httpx.HTTPTransport()
        try:
            self._http = httpx.Client(
                base_url=url.rstrip("/"), headers=headers, timeout=SECONDS, transport=transport
            )
        except self._errors as error:
            raise InputError(
                f"{url}: not a valid address; give e.g. http://127.0.0.1:8765."
            ) from error
        # Closes the connections if the user does not, with the last client that shares them.
        weakref.finalize(self._http, transport.close)
        try:
            listed = self._get("/v1/maps", patience=0.0)
        except ServerError as error:
            if isinstance(error.__cause__, self._errors):
                raise InputError(f"{error} Start `ambinav serve`, or give another address.") from (
                    error.__cause__
                )
            raise
        try:
            served = {info["id"]: info for info in listed["maps"]}
            digests = [info["digest"] for info in served.values()]
        except (TypeError, KeyError):
            raise InputError(_no_server(url)) from None
        if not all(digests):
            raise InputError(_no_server(url))
        if map is None and len(served) != 1:
            raise InputError(f"{url} serves {', '.join(served) or 'no map'}; name one of them.")
        self.id = next(iter(served)) if map is None else map
        self.info: dict[str, Any] = served.get(self.id) or self._unlisted(served)
        self._match = {"if-match": f'"{self.info["digest"]}"'}
        self.layer = self.info["cost_layer"] if layer is None else layer
        self._layers = {layer_info["name"]: layer_info for layer_info in self.info["layers"]}
        if self.layer not in self._layers:
            raise InputError(f"{url}: the map {self.id!r} has no layer {self.layer!r}.")
        self.weight = as_nonnegative(weight, "weight")
        self.power, self.clearance_weight, self.comfort = 1.0, 0.0, 0.5
        self.preferred, self.outside_weight, self.plain = None, 1.0, None
        self._base: list[AmbiguityService] = []  # shared by all weights

    def _unlisted(self, served: Mapping[str, Any]) -> dict[str, Any]:
        """Return the description of a map that is not listed, as edited ones are not."""
        try:
            info: dict[str, Any] = self._get(f"/v1/maps/{quote(self.id, safe='')}", patience=0.0)
        except InputError:
            url = self._connection[0]
            raise InputError(
                f"{url} has no map {self.id!r}; it serves {', '.join(served)}."
            ) from None
        return info

    def __getattr__(self, name: str) -> Any:
        """Fetch the map at the first access to an attribute that needs it."""
        if name not in _FETCHED:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        if not self._base:
            self._base.append(AmbiguityService(self._fetch(), self.layer, self.weight))
        value = getattr(self._base[0].with_weight(self.weight), name)
        setattr(self, name, value)
        return value

    def __reduce__(self) -> tuple[Any, ...]:
        """Return a new client for the process or thread that receives it."""
        url, token, patience = self._connection
        return _connected, (url, self.id, token, self.layer, self.weight, patience)

    def __repr__(self) -> str:
        """Return address, map, layer and weight."""
        url, layer = self._connection[0], self.layer
        return f"Client({url!r}, {self.id!r}, layer={layer!r}, weight={self.weight:g})"

    def __enter__(self) -> Self:
        """Return the client itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the connections."""
        self.close()

    def close(self) -> None:
        """Close the connections to the server, for all weights; later requests are refused."""
        self._http.close()

    @property
    def has_headings(self) -> bool:
        """True if the cost depends on the heading."""
        return bool(self._layers[self.layer]["has_theta"])

    def with_weight(self, weight: float) -> Client:
        """Return the same client at another weight, sharing connections and fetched data."""
        if weight == self.weight:
            return self
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other.weight = as_nonnegative(weight, "weight")
        other.__dict__.pop("density", None)
        return other

    @overload
    def level(
        self, x: Scalar, y: Scalar, theta: Scalar | None = None, *, layer: str | None = None
    ) -> float: ...

    @overload
    def level(
        self,
        x: ArrayLike,
        y: ArrayLike,
        theta: ArrayLike | None = None,
        *,
        layer: str | None = None,
    ) -> Floats: ...

    def level(
        self,
        x: ArrayLike,
        y: ArrayLike,
        theta: ArrayLike | None = None,
        *,
        layer: str | None = None,
    ) -> Floats | float:
        """Return a layer's values at poses, as `AmbiguityMap.sample`; None: the client's layer."""
        return self._request_rows(
            "level", POSE_COLUMNS, (x, y, theta), {"layer": layer or self.layer}
        )

    def _cost(self, x: ArrayLike, y: ArrayLike, theta: ArrayLike | None) -> Floats | float:
        query = {"layer": self.layer, "weight": repr(self.weight)}
        return self._request_rows("cost", POSE_COLUMNS, (x, y, theta), query)

    def _reward(self, start: Pose, end: Pose, steering: Steering | None) -> Floats | float:
        (x0, y0, theta0), (x1, y1, theta1) = start, end
        query = {"layer": self.layer}
        if steering is not None:
            query |= {"steering": steering.space, "turning_radius": repr(steering.radius)}
        return self._request_rows("reward", STEP_COLUMNS, (x0, y0, x1, y1, theta0, theta1), query)

    def _request_rows(
        self,
        endpoint: str,
        names: tuple[str, ...],
        values: Sequence[ArrayLike | None],
        query: dict[str, str],
    ) -> Floats | float:
        """Request one number for each row of the columns; headings that are None are omitted."""
        columns = [
            (name, value)
            for name, value in zip(names, values, strict=True)
            if value is not None or not name.startswith("theta")
        ]
        shape, flat = as_flat(**{name: math.nan if v is None else v for name, v in columns})
        query = query | {"columns": ",".join(name for name, _ in columns)}
        count = flat[0].size
        out = np.empty(count)
        for low in range(0, count, PIECE):
            piece = slice(low, min(low + PIECE, count))
            body = packed(column[piece] for column in flat)
            out[piece] = np.frombuffer(self._post(endpoint, body, query), dtype="<f8")
        return out.reshape(shape) if shape else float(out[0])

    def _post(self, endpoint: str, body: bytes, query: dict[str, str]) -> bytes:
        path = f"/v1/maps/{self.id}/{endpoint}"
        headers = {"content-type": OCTETS}
        answer = self._send("POST", path, content=body, params=query, headers=headers)
        return bytes(answer.content)

    def _get(self, path: str, patience: float | None = None) -> Any:
        answer = self._send("GET", path, patience)
        try:
            return answer.json()
        except ValueError:
            raise InputError(_no_server(self._connection[0])) from None

    def _send(self, method: str, path: str, patience: float | None = None, **options: Any) -> Any:
        """Send a request and return the answer, after several attempts if that may help."""
        options["headers"] = options.get("headers", {}) | self._match

        def attempt() -> Any:
            answer = self._http.request(method, path, **options)
            self._check(answer)
            return answer

        return self._repeated(attempt, patience)

    def _repeated(self, attempt: Callable[[], T], patience: float | None = None) -> T:
        """Return the result of an attempt, repeated while the server is gone or busy.

        Raises:
            InputError: the client is closed.
        """
        import httpx

        if self._http.is_closed:
            raise InputError(f"the client of {self._connection[0]} is closed; make a new one.")
        end = time.monotonic() + (self._connection[2] if patience is None else patience)
        pause, closed = PAUSE, False
        while True:
            wait = pause
            try:
                return attempt()
            except _BusyError as error:
                last: Exception = error
                wait = max(error.seconds, pause)
            except self._errors as error:
                last = self._unanswered(error)
                # An idle connection that the server has closed says nothing about the server.
                if isinstance(error, httpx.RemoteProtocolError) and not closed:
                    closed, wait = True, 0.0
                    end = max(end, time.monotonic() + PAUSE)
            if time.monotonic() + wait > end:
                if isinstance(last, _BusyError):
                    raise ServerError(str(last)) from None
                raise last from last.__cause__
            time.sleep(wait)
            pause = min(2.0 * pause, LONGEST)

    def _fetch(self) -> AmbiguityMap:
        """Fetch the map with all its arrays."""
        address = f"/v1/maps/{self.id}/map.npz"
        with tempfile.TemporaryDirectory(prefix="ambinav-") as folder:
            path = Path(folder) / "map.npz"

            def attempt() -> None:
                with (
                    self._http.stream("GET", address, timeout=None, headers=self._match) as answer,
                    path.open("wb") as file,
                ):
                    if answer.status_code != 200:
                        answer.read()
                        self._check(answer)
                    for piece in answer.iter_bytes():
                        file.write(piece)

            self._repeated(attempt)
            return read_map(path, f"{self._connection[0]}{address}")

    def _unanswered(self, error: Exception) -> ServerError:
        failure = ServerError(
            f"{self._connection[0]}: no server answers there ({type(error).__name__})."
        )
        failure.__cause__ = error
        return failure

    def _check(self, answer: Any) -> None:
        """Raise the error that an answer reports."""
        if answer.status_code == 200:
            return
        try:
            detail = str(answer.json()["detail"])
        except (ValueError, KeyError, TypeError):
            detail = f"{self._connection[0]} answers with the status {answer.status_code}."
        if answer.status_code in BUSY:
            raise _BusyError(detail, answer.headers.get("retry-after", ""))
        if answer.status_code == CHANGED:
            raise ServerError(
                f"{self._connection[0]}: the map {self.id!r} is another one since this client was "
                "created; create a new client."
            )
        if answer.status_code >= 500:
            raise ServerError(detail)
        raise InputError(detail)


class _BusyError(Exception):
    """An answer after which the same request may have better luck, in some seconds."""

    def __init__(self, detail: str, after: str) -> None:
        super().__init__(detail)
        self.seconds = float(after) if after.isdigit() else 0.0


def _no_server(url: str) -> str:
    return f"{url}: this is not an ambinav server; give the address that `ambinav serve` prints."


def _connected(
    url: str, map: str, token: str | None, layer: str, weight: float, patience: float
) -> Client:
    return Client(url, map, token, layer=layer, weight=weight, patience=patience)
