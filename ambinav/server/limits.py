"""Limits of requests: sizes, times and counts."""

from __future__ import annotations

from dataclasses import dataclass, field

from ambinav.runtime.processes import processors


@dataclass(frozen=True)
class Limits:
    """Limits of one request and of all jobs together.

    Attributes:
        body: Bytes of a body.
        json: Bytes of a body in JSON, or of no known type: reading it holds up all other requests.
        upload: Bytes of a body of uploaded files.
        body_seconds: Time for a body to arrive.
        head: Bytes of a request before its body, about: they are kept until all have come.
        head_seconds: Time for the head of a request to arrive, also on a new connection.
        write_seconds: Time in which a client must read what waits to be sent.
        connections: Open connections of a client; proxies that are trusted have no limit.
        client_requests: Requests of a client that are answered at the same time.
        client_jobs: Plans, edits and audits of a client that run or wait.
        batch: Poses or steps of a batch.
        metres: Travelled by the steps of a batch, about.
        plan_seconds: Longest planning time of a request.
        job_seconds: Time after which a plan is stopped.
        audit_seconds: Time after which an audit is stopped.
        plans: Plans that run at the same time.
        audits: Audits that run at the same time.
        waiting: Jobs of a kind that may wait for their turn.
        kept_audits: Finished audits whose map and report are kept; the oldest go first.
        audit_cells: Cells of an uploaded map's ambiguity map, over all headings.
        audit_beams: Beams of the scanner of an audit.
        weights: Weights of a Pareto front.
        edits: Edits that are worked out at the same time.
        edit_seconds: Time after which an edit is stopped.
        obstacles: Obstacles of an edit.
        corners: Corners of all obstacles of an edit together.
        kept_edits: Edited maps that are kept; of whoever has the most, the oldest go first.
        edit_bytes: Approximate bytes of the layers of all edited maps; the last map always stays.
    """

    body: int = 32 * 2**20
    json: int = 4 * 2**20
    upload: int = 64 * 2**20
    body_seconds: float = 30.0
    head: int = 64 * 1024
    head_seconds: float = 15.0
    write_seconds: float = 60.0
    connections: int = 512
    client_requests: int = 128
    client_jobs: int = 8
    batch: int = 1_000_000
    metres: float = 5e7
    plan_seconds: float = 30.0
    job_seconds: float = 120.0
    audit_seconds: float = 900.0
    plans: int = field(default_factory=lambda: max(processors() // 2, 1))
    audits: int = 1
    waiting: int = 8
    kept_audits: int = 8
    audit_cells: int = 4_000_000
    audit_beams: int = 20_000
    weights: int = 25
    edits: int = 1
    edit_seconds: float = 120.0
    obstacles: int = 100
    corners: int = 1000
    kept_edits: int = 8
    edit_bytes: int = 2**30
