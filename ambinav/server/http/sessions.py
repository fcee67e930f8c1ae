"""Routes of sessions: the history of the edits of a map, with undo and redo."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Path, Request
from pydantic import BaseModel, Field
from starlette.responses import Response

from ambinav.server.http.context import Context, context_of
from ambinav.server.http.edits import NAME, Edited, edited_answer
from ambinav.server.http.models import as_json
from ambinav.server.jobs.edit_sessions import EditedMap
from ambinav.server.jobs.plan_jobs import while_connected
from ambinav.server.problems import Problem, answers
from ambinav.server.served import ServedMap

router = APIRouter(prefix="/v1/maps/{id}/sessions/{session}", tags=["editing"])

Name = Annotated[str, Path(description="Name of the session", pattern=NAME)]

_MOVES = answers(401, 403, 404, 409, 422, 429, 503, 504)


class Step(BaseModel):
    """An edit of a session."""

    number: int = Field(description="From 1 on")
    map: str = Field(description="Id of the edited map; its obstacles are at `obstacles.geojson`")
    time: str = Field(description="Time of the edit, ISO 8601")
    editor: str | None = Field(description="Name that its editor gave")


class Session(BaseModel):
    """A session of edits."""

    session: str = Field(description="Name of the session")
    map: str = Field(description="Id of the original map")
    position: int = Field(description="Number of the current step; 0: the original")
    current: str = Field(description="Id of the current map")
    steps: list[Step] = Field(description="All steps; those beyond the position were undone")


async def _original(request: Request, id: str) -> tuple[Context, ServedMap]:
    context = context_of(request)
    base = await context.map(request, id)
    if isinstance(base, EditedMap):
        raise Problem(422, f"{id!r} is edited; sessions are of {base.base.name!r}.", field="id")
    return context, base


@router.get(
    "", summary="A session of edits", response_model=Session, responses=answers(401, 404, 422)
)
async def get_session(request: Request, id: str, session: Name) -> Response:
    """Return the steps of a session; it has none before its first edit.

    Sessions survive a restart of the server if it was started with `--state`.
    """
    context, base = await _original(request, id)
    position, steps = context.state.steps(session, base.name)
    return as_json(
        Session(
            session=session,
            map=base.name,
            position=position,
            current={n: name for n, name, _, _ in steps}.get(position, base.name),
            steps=[
                Step(
                    number=n,
                    map=name,
                    time=datetime.fromtimestamp(created, UTC).isoformat(),
                    editor=editor,
                )
                for n, name, created, editor in steps
            ],
        )
    )


@router.post("/undo", summary="Undo an edit", response_model=Edited, responses=_MOVES)
async def post_undo(request: Request, id: str, session: Name) -> Response:
    """Go back a step in a session; its map is computed again if it must be."""
    return await _moved(request, id, session, -1)


@router.post("/redo", summary="Redo an edit", response_model=Edited, responses=_MOVES)
async def post_redo(request: Request, id: str, session: Name) -> Response:
    """Go forward a step in a session, after `undo`."""
    return await _moved(request, id, session, 1)


async def _moved(request: Request, id: str, session: str, by: int) -> Response:
    context, base = await _original(request, id)

    async def work() -> Edited:
        begun = time.monotonic()
        edited, step = await context.edits.moved(base, session, by)
        return await edited_answer(context, base, edited, step, time.monotonic() - begun)

    return as_json(await while_connected(request, work()))


@router.delete(
    "",
    summary="Delete a session",
    status_code=204,
    response_class=Response,
    responses=answers(401, 403, 404, 422),
)
async def delete_session(request: Request, id: str, session: Name) -> Response:
    """Forget the steps of a session; its maps can still be requested by their ids for a while."""
    context, base = await _original(request, id)
    context.state.delete_session(session, base.name)
    return Response(status_code=204)
