"""`ambinav serve`: maps over HTTP, and the web page."""

from __future__ import annotations

import errno
import resource
import socket
from typing import Annotated

import typer

from ambinav.cli.packages import need
from ambinav.cli.running import note, reporting
from ambinav.runtime.errors import InputError

BACKLOG = 2048
"""Connections that wait to be accepted, as in uvicorn."""


def serve(
    maps: Annotated[
        list[str],
        typer.Argument(
            metavar="MAP.zarr...",
            help="Ambiguity maps made by `ambinav map`: folders, or URLs such as "
            "s3://maps/office.zarr.",
            show_default=False,
        ),
    ],
    host: Annotated[
        str,
        typer.Option(
            "--host",
            metavar="ADDRESS",
            help="Address to listen on; 0.0.0.0: all network interfaces.",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", metavar="N", help="Port; 0: any free port.")
    ] = 8765,
    token: Annotated[
        str | None,
        typer.Option(
            "--token",
            metavar="TEXT",
            envvar="AMBINAV_TOKEN",
            help="Answer only requests with the header `Authorization: Bearer TEXT`.",
            show_default="no token is required",
        ),
    ] = None,
) -> None:
    """Serve ambiguity maps over HTTP to other programs and as a web page.

    Example: `ambinav serve office.zarr`
    """
    with reporting():
        need("ambinav serve", ("fastapi", "uvicorn"), "serve")
        if not 0 <= port <= 65535:
            raise InputError(f"--port: {port} is no port; give 0 to 65535.")
        if token is not None and not (token.isascii() and token.isprintable() and token.strip()):
            raise InputError("--token: give printable ASCII characters.")
        listening = _listen(host, port)
        with listening:
            from ambinav.server.http.app import LOOPBACK, create_app
            from ambinav.server.http.running import Server, favour_requests

            local = host in LOOPBACK
            app = create_app(maps, token=token, hosts=LOOPBACK if local else None)
            if not local and token is None:
                note(f"anyone who can reach {host} can use this server; --token restricts access.")
            _many_connections()
            app.state.context.prepare()
            favour_requests()
            listening.listen(BACKLOG)  # whoever reads the address may connect at once
            number = listening.getsockname()[1]
            shown = f"[{host}]" if ":" in host else host
            typer.echo(f"http://{shown}:{number}/  (Ctrl-C ends the server)")
            Server(app).run([listening])


def _listen(host: str, port: int) -> socket.socket:
    """Return a bound socket, before the long work of opening maps.

    Raises:
        InputError: the address or the port cannot be had.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        opened = socket.socket(family, kind, protocol)
    except OSError as error:
        raise InputError(f"--host: {host!r} is no address here ({error.strerror}).") from error
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(address)
    except OSError as error:
        opened.close()
        if error.errno == errno.EADDRINUSE:
            raise InputError(
                f"--port: {port} is in use on {host}; stop the program that uses it, or give "
                "another port, e.g. 0 for any free port."
            ) from error
        if error.errno == errno.EACCES:
            raise InputError(f"--port: {port} needs privileges; give one from 1024 on.") from error
        raise InputError(
            f"--host: {host!r} cannot be used to listen ({error.strerror}); give an address of "
            "this "
            "machine, e.g. 127.0.0.1."
        ) from error
    return opened


def _many_connections() -> None:
    """Raise the limit of open files to the maximum: each connection needs one."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
