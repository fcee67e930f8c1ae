"""Metrics in Prometheus' text form, and a log with one line of JSON for each request."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any, Final

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    disable_created_metrics,
    generate_latest,
)

from ambinav.server.guard import App, Message, Receive, Scope, Send, client_of
from ambinav.version import __version__

ACCESS_LOG: Final = "ambinav.access"
"""Logger of the requests; its records hold their fields as `request`."""
GONE: Final = 499
"""Status in log and metrics of a request whose client closed the connection, as in nginx."""
BUCKETS: Final = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Upper ends of the classes of durations, seconds."""


class Metrics:
    """Counts and durations of an application's requests, and the state of its jobs."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        registry = self.registry
        disable_created_metrics()  # type: ignore[no-untyped-call]
        ProcessCollector(registry=registry)
        labels = ("method", "route", "status")
        self.requests = Counter("ambinav_requests", "Requests", labels, registry=registry)
        self.seconds = Histogram(
            "ambinav_request_seconds",
            "Time until an answer was sent",
            ("route",),
            buckets=BUCKETS,
            registry=registry,
        )
        self.open = Gauge("ambinav_requests_open", "Requests under way", registry=registry)
        info = Gauge("ambinav_info", "The program", ("version",), registry=registry)
        info.labels(__version__).set(1)

    def gauge(self, name: str, text: str, value: Callable[[], float]) -> None:
        """Add a figure that is read when the metrics are requested."""
        Gauge(f"ambinav_{name}", text, registry=self.registry).set_function(value)

    def text(self) -> bytes:
        """Return all figures in Prometheus' text form."""
        return generate_latest(self.registry)


class Observer:
    """Middleware that measures and logs requests."""

    def __init__(self, app: App, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics
        self._log = logging.getLogger(ACCESS_LOG)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request and note its answer."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun, status, size, path = time.perf_counter(), GONE, 0, scope["path"]

        async def noted(message: Message) -> None:
            nonlocal status, size
            await send(message)
            if message["type"] == "http.response.start":
                status = message["status"]
            size += len(message.get("body", b""))

        self._metrics.open.inc()
        try:
            await self._app(scope, receive, noted)
        finally:
            self._metrics.open.dec()
            seconds = time.perf_counter() - begun
            route = getattr(scope.get("route"), "path", None) or "other"  # few: they are labels
            self._metrics.requests.labels(scope["method"], route, status).inc()
            self._metrics.seconds.labels(route).observe(seconds)
            if self._log.isEnabledFor(logging.INFO):
                request = {
                    "client": client_of(scope),
                    "method": scope["method"],
                    "path": path[:500],
                    "route": route,
                    "status": status,
                    "bytes": size,
                    "ms": round(1e3 * seconds, 2),
                }
                self._log.info("request", extra={"request": request})


class JsonLines(logging.Formatter):
    """A record as one line of JSON."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        line: dict[str, Any] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        line |= getattr(record, "request", {})
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line)


def log_json() -> None:
    """Write the log of the server and of its requests as JSON to the standard error."""
    handler = logging.StreamHandler()
    handler.setFormatter(JsonLines())
    for name, level in (("ambinav", logging.INFO), ("uvicorn", logging.WARNING)):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
        logger.setLevel(level)
