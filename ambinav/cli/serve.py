"""`ambinav serve`: maps over HTTP, and the web page."""

from __future__ import annotations

import errno
import ipaddress
import resource
import socket
from pathlib import Path
from typing import Annotated, Any

import typer

from ambinav.cli.options import documented
from ambinav.cli.running import OUR_FAULT, reporting, say
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import need

BACKLOG = 2048
"""Connections that wait to be accepted, as in uvicorn."""


@documented
def serve(
    maps: Annotated[list[str], typer.Argument()],
    host: str = "127.0.0.1",
    port: int = 8765,
    token: Annotated[str | None, typer.Option("--token", envvar="AMBINAV_TOKEN")] = None,
    read_token: Annotated[
        str | None, typer.Option("--read-token", envvar="AMBINAV_READ_TOKEN")
    ] = None,
    insecure: bool = False,
    allowed_host: list[str] | None = None,
    public_url: str | None = None,
    trusted_proxy: list[str] | None = None,
    state: Path | None = None,
    log: bool = False,
    check: bool = False,
) -> None:
    """Serve ambiguity maps over HTTP to other programs and as a web page.

    Example: `ambinav serve office.zarr`

    Parameters:
        maps (MAP.zarr...): Ambiguity maps made by `ambinav map`: folders, or URLs such as
            s3://maps/office.zarr.
        host (ADDRESS): Address to listen on; 0.0.0.0: all network interfaces.
        port (N): Port; 0: any free port.
        token (TEXT): Answer only requests with the header `Authorization: Bearer TEXT`. [default:
            no token is required]
        read_token (TEXT): Token for everything except edits and audits, which need --token.
            [default: none]
        insecure: Listen to other machines without a token.
        allowed_host (NAME): A further name of this server in addresses; several times for several.
            [default: this machine's own]
        public_url (URL): Address of the page behind a proxy, e.g. https://maps.example.org/ambinav.
            [default: the server's own]
        trusted_proxy (ADDRESS): Address or network of a proxy whose X-Forwarded-For and
            X-Forwarded-Proto are used; several times for several. [default: none]
        state (DIR): Keep edits, plans and audits in this folder, for the next start. [default: they
            end with the server]
        log: Write one line of JSON per request to the standard error.
        check: Exit as soon as the server is ready, with status 1 if a part of it does not run.
    """
    with reporting():
        need("ambinav serve", ("fastapi", "uvicorn", "prometheus_client"), "serve")
        if not 0 <= port <= 65535:
            raise InputError(f"--port: {port} is not a valid port; give 0 to 65535.")
        for name, text in (("--token", token), ("--read-token", read_token)):
            if text is not None and not (text.isascii() and text.isprintable() and text.strip()):
                raise InputError(f"{name}: give printable ASCII characters.")
        proxies = tuple(_network(proxy) for proxy in trusted_proxy or ())
        from ambinav.server.access import LOOPBACK, Access

        local = host in LOOPBACK
        access = Access(
            token,
            read_token,
            (
                *LOOPBACK,
                *((host, socket.gethostname()) if not local else ()),
                *(allowed_host or ()),
            ),
            any_address=not local,
            public_url=public_url,
        )
        listening = _listen(host, port)
        with listening:
            if not local and access.is_open and not insecure:
                raise InputError(
                    f"--host: anyone who can reach {host} could use this server; give --token or "
                    "--read-token, or --insecure if that is intended."
                )
            from ambinav.server.http.app import create_app
            from ambinav.server.http.running import Server, favour_requests
            from ambinav.server.observer import log_json

            app = create_app(maps, access=access, state=state, processes=True)
            _many_connections()
            favour_requests()
            listening.listen(BACKLOG)  # whoever reads the address may connect at once
            number = listening.getsockname()[1]
            shown = f"[{host}]" if ":" in host else host
            typer.echo(f"http://{shown}:{number}/  (Ctrl-C ends the server)")
            options: dict[str, Any] = {}
            if log:
                log_json()
                options["log_config"] = None
            server = Server(app, proxies=proxies, **options)

            def on_ready(seconds: float) -> None:
                typer.echo(f"ready after {seconds:.1f} s")
                favour_requests()
                server.should_exit = server.should_exit or check

            app.state.context.warming.then(on_ready)
            server.run([listening])
            if check and app.state.context.warming.failed:
                say("ambinav: error: the server is not fully prepared; its log above says why.")
                raise typer.Exit(OUR_FAULT)


def _network(proxy: str) -> str:
    """Return the address or network of a proxy.

    Raises:
        InputError: it is none.
    """
    try:
        return str(ipaddress.ip_network(proxy))
    except ValueError as error:
        raise InputError(
            f"--trusted-proxy: {proxy!r} is not an address or a network ({error}); give e.g. "
            "10.0.0.7 or 10.0.0.0/8."
        ) from error


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
        raise InputError(
            f"--host: {host!r} is not an address of this machine ({error.strerror})."
        ) from error
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
            f"--host: {host!r} cannot be used to listen ({error.strerror}); give an address "
            "of this machine, e.g. 127.0.0.1."
        ) from error
    return opened


def _many_connections() -> None:
    """Raise the limit of open files to the maximum: each connection needs one."""
    _, hard_limit = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard_limit, hard_limit))
