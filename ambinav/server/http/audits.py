"""Routes of audits: upload a map, follow its progress, read its report."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated, Final, Literal

from fastapi import APIRouter, File, Form, Request, UploadFile
from pydantic import BaseModel, Field
from pydantic_core import to_json
from starlette.responses import FileResponse, Response, StreamingResponse

from ambinav.runtime.errors import InputError
from ambinav.sensing.presets import preset_names
from ambinav.sensing.scanner import RangeScanner
from ambinav.server.guard import client_of
from ambinav.server.http.context import context_of
from ambinav.server.http.models import as_json
from ambinav.server.jobs.audit_jobs import Audit
from ambinav.server.jobs.workers import AuditTask
from ambinav.server.problems import Problem, answers

router = APIRouter(prefix="/v1", tags=["audits"])

PING: Final = 15.0
"""Seconds after which a quiet stream of events says that it is still there."""


class AuditInfo(BaseModel):
    """Progress of an audit."""

    id: str
    state: Literal["waiting", "running", "done", "failed", "cancelled"]
    stage: str = Field(description="Current stage: waiting, read, map or report")
    done: float = Field(description="Completed fraction of the stage, 0 to 1")
    map: str | None = Field(description="Id of the served map, when the audit is done")
    report: str | None = Field(description="Path of the report, when the audit is done")
    detail: str | None = Field(description="Reason of the failure, in a sentence")


def _info(audit: Audit, prefix: str) -> AuditInfo:
    done = audit.served is not None
    return AuditInfo(
        id=audit.id,
        state=audit.state,
        stage=audit.stage,
        done=audit.done,
        map=audit.served.name if audit.served else None,
        report=f"{prefix}/v1/audits/{audit.id}/report" if done else None,
        detail=audit.detail,
    )


@router.get(
    "/scanners",
    summary="Names of the scanner presets",
    response_model=list[str],
    responses=answers(401),
)
async def get_scanners() -> Response:
    """Return the names accepted for `scanner`."""
    return as_json(list(preset_names()))


@router.post(
    "/audits",
    summary="Audit a map",
    status_code=202,
    response_model=AuditInfo,
    responses=answers(400, 401, 403, 408, 413, 422, 429, 503),
)
async def post_audit(
    request: Request,
    files: Annotated[
        list[UploadFile],
        File(description="A plan (.geojson, .wkt), or a map_server .yaml and its image"),
    ],
    scanner: Annotated[str, Form(description="Name of a preset, or the text of a scanner file")],
    spacing: Annotated[
        float, Form(description="Distance between map cells, metres", ge=0.02, le=5.0)
    ] = 0.1,
    radius: Annotated[
        float,
        Form(
            description="Radius around a pose within which scans are compared, metres",
            gt=0.0,
            le=5.0,
        ),
    ] = 0.5,
    headings: Annotated[
        int | None, Form(description="Number of headings; none: the scanner decides", ge=1, le=360)
    ] = None,
    level: Annotated[
        str | None, Form(description="Floor of a plan with several, by name or position from 0 on")
    ] = None,
    unit: Annotated[
        Literal["m", "cm", "mm", "in", "ft"] | None,
        Form(description="Unit of a plan's coordinates; none: metres"),
    ] = None,
) -> Response:
    """Start the audit of an uploaded map; `events` reports its progress.

    When it is done, its ambiguity map is served like the others, until too many audits have
    followed or the server ends.
    """
    context = context_of(request)
    if radius < spacing:
        raise Problem(
            422, f"radius is {radius:g} m and spacing {spacing:g} m; give a radius of at least one "
            "spacing.", field="radius",
        )  # fmt: skip
    chosen = await context.in_thread(_scanner, scanner, context.limits.audit_beams)
    task = AuditTask(chosen, spacing, radius, headings, level, unit)
    audit = await context.audits.begin(files, task, client_of(request.scope))
    location = f"{context.prefix}/v1/audits/{audit.id}"
    return as_json(_info(audit, context.prefix), 202, location=location)


MOST_SCANNER: Final = 100_000
"""Characters of a scanner file: reading it takes a second for each megabyte or more."""


def _scanner(scanner: str, most: int) -> str:
    """Return the text of a scanner given by name or as text.

    Raises:
        InputError: it is none, or has more than `most` beams.
    """
    if len(scanner) > MOST_SCANNER:
        raise InputError(
            f"scanner: the text has {len(scanner)} characters; give at most {MOST_SCANNER}."
        )
    chosen = (
        RangeScanner.from_yaml_text(scanner, file="scanner")
        if "\n" in scanner
        else RangeScanner.from_preset(scanner)
    )
    text = f"{chosen.name}{chosen.description}{chosen.source}"
    if any("\ud800" <= character <= "\udfff" for character in text):
        raise InputError(
            "scanner: its name, description or source contains an unpaired surrogate, which no "
            "file can store; correct it."
        )
    if chosen.beams > most:
        raise InputError(
            f"scanner: it has {chosen.beams} beams, more than the {most} that this server takes; "
            "give fewer."
        )
    return chosen.to_yaml()


@router.get(
    "/audits/{id}", summary="An audit", response_model=AuditInfo, responses=answers(401, 404)
)
async def get_audit(request: Request, id: str) -> Response:
    """Return the progress of an audit."""
    context = context_of(request)
    return as_json(_info(context.audits.get(id), context.prefix))


@router.get(
    "/audits/{id}/events",
    summary="Progress of an audit",
    response_class=Response,
    responses={
        **answers(401, 404),
        200: {"description": "Server-sent events", "content": {"text/event-stream": {}}},
    },
)
async def get_events(request: Request, id: str) -> Response:
    """Stream the progress of an audit as server-sent events.

    `progress` {done, total, stage}, at last one `done` {map, report} or `failed` {detail}.
    """
    context = context_of(request)
    return StreamingResponse(
        _events(context.audits.get(id), context.prefix),
        media_type="text/event-stream",
        headers={"cache-control": "no-store"},
    )


async def _events(audit: Audit, prefix: str) -> AsyncIterator[bytes]:
    while True:
        changed = audit.changed
        info = _info(audit, prefix)
        if info.state == "done":
            yield _event("done", {"map": info.map, "report": info.report})
            return
        if info.state in ("failed", "cancelled"):
            yield _event("failed", {"detail": info.detail})
            return
        yield _event("progress", {"done": info.done, "total": 1.0, "stage": info.stage})
        while not changed.is_set():
            try:
                await asyncio.wait_for(changed.wait(), PING)
            except TimeoutError:
                yield b": still there\n\n"


def _event(name: str, data: object) -> bytes:
    return b"event: " + name.encode() + b"\ndata: " + to_json(data) + b"\n\n"


@router.get(
    "/audits/{id}/report",
    summary="Report of an audit",
    response_class=Response,
    responses={
        **answers(401, 404, 409),
        200: {"description": "A self-contained HTML page", "content": {"text/html": {}}},
    },
)
async def get_report(request: Request, id: str) -> Response:
    """Return the report as a page; available once the audit is done."""
    audit = context_of(request).audits.get(id)
    if audit.state != "done":
        raise Problem(409, f"The audit is {audit.state} and has no report.")
    return FileResponse(
        audit.report, media_type="text/html", headers={"content-security-policy": "sandbox"}
    )


@router.delete(
    "/audits/{id}",
    summary="Cancel an audit",
    status_code=204,
    response_class=Response,
    responses=answers(401, 403, 404),
)
async def delete_audit(request: Request, id: str) -> Response:
    """Stop an audit if it still runs, and delete its map and report."""
    audits = context_of(request).audits
    await audits.cancel(audits.get(id))
    return Response(status_code=204)
