"""A server that runs in a thread of the tests."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import httpx
from fastapi import FastAPI

from ambinav.server.http.context import Context
from ambinav.server.http.running import Server


@dataclass
class Live:
    """A server that runs in a thread."""

    app: FastAPI
    url: str
    http: httpx.Client
    address: tuple[str, int]

    @property
    def context(self) -> Context:
        context = self.app.state.context
        assert isinstance(context, Context)
        return context

    def get(self, path: str, **query: Any) -> Any:
        answer = self.http.get(path, params=query)
        assert answer.status_code == 200, answer.text
        return answer.json()


@contextmanager
def running(app: FastAPI, *, port: int = 0, **options: Any) -> Iterator[Live]:
    """Serve an application on a port, 0: one that is free; options as of `Server`."""
    listening = socket.create_server(("127.0.0.1", port), backlog=128)
    server = Server(app, log_level="error", timeout_graceful_shutdown=2, **options)
    thread = threading.Thread(target=server.run, args=([listening],))
    thread.start()
    address = listening.getsockname()
    url = f"http://127.0.0.1:{address[1]}"
    try:
        with httpx.Client(base_url=url, timeout=60.0) as http:
            yield Live(app, url, http, address)
    finally:
        server.should_exit = True
        thread.join(30.0)
        listening.close()
        assert not thread.is_alive()


def wait_until(condition: Any, seconds: float = 60.0) -> None:
    """Wait for something to come to pass."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come to pass"
        time.sleep(0.01)
