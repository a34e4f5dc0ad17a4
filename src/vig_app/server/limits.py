"""Limits of requests, before much of them is read: their origin, key, rate, size and time."""

from __future__ import annotations

import asyncio
import base64
import secrets
import time
from collections import OrderedDict, deque
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from fastapi import HTTPException
from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from vig_app.viewer.server import is_own_host

CLOSE = {"Connection": "close"}
OPEN = ("/health",)
"""Paths that need no key."""
MOST_CLIENTS = 10_000
"""Addresses whose requests are counted at a time."""


@dataclass
class Limits:
    """Middleware that refuses requests: 401, 403, 408, 413 or 429 with a line in `error`.

    Attributes:
        app: Application behind it.
        key: Key of `X-API-Key`, a bearer's token or the password of basic authentication; None for none.
        most_bytes: Bytes of a request's body.
        per_minute: Requests of an address in a minute.
        seconds: Time in which a request must have come.
    """

    app: ASGIApp
    key: str | None = None
    most_bytes: int = 25_000_000
    per_minute: int = 600
    seconds: float = 30.0
    requests: OrderedDict[str, deque[float]] = field(default_factory=OrderedDict)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or let the application do so."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        refusal = self._refusal(scope, Headers(scope=scope))
        if refusal is not None:
            await refusal(scope, receive, send)
            return
        size, more, until = 0, True, time.monotonic() + self.seconds

        async def limited() -> Message:
            nonlocal size, more
            if not more:
                return await receive()
            try:
                message = await asyncio.wait_for(receive(), until - time.monotonic())
            except TimeoutError:
                words = f"expected the whole request within {self.seconds:g} s; got a part."
                raise HTTPException(408, words, CLOSE) from None
            size += len(message.get("body", b""))
            more = message.get("more_body", False)
            if size > self.most_bytes:
                raise HTTPException(413, self._too_large, CLOSE)
            return message

        await self.app(scope, limited, send)

    def _refusal(self, scope: Scope, headers: Headers) -> JSONResponse | None:
        """Return the refusal of a request by its headers; None where there is none."""
        origin, host = headers.get("origin"), headers.get("host", "")
        foreign = origin is not None and urlsplit(origin).netloc != host
        if foreign or (self.key is None and not is_own_host(host)):
            return _refuse(403, "expected a request of no page of another site; got one.")
        if self.key is not None and scope["path"] not in OPEN and not _has_key(headers, self.key):
            return _refuse(401, "expected the key of vig serve as X-API-Key; got none or another.")
        wait = self._wait(scope["client"][0] if scope["client"] else "")
        if wait > 0:
            refusal = _refuse(429, f"expected {self.per_minute} requests a minute at most; got more.")
            refusal.headers["Retry-After"] = str(round(wait + 0.5))
            return refusal
        length = headers.get("content-length", "0")
        large = not length.isdecimal() or int(length) > self.most_bytes
        return _refuse(413, self._too_large) if large else None

    def _wait(self, client: str) -> float:
        """Count a request; return seconds until the client may send one, 0 for now."""
        now, times = time.monotonic(), self.requests.setdefault(client, deque())
        self.requests.move_to_end(client)
        if len(self.requests) > MOST_CLIENTS:
            self.requests.popitem(last=False)
        while times and times[0] < now - 60:
            times.popleft()
        if len(times) >= self.per_minute:
            return times[0] + 60 - now
        times.append(now)
        return 0.0

    @property
    def _too_large(self) -> str:
        return f"expected at most {self.most_bytes:,} bytes; got more. Send a smaller photo."


def _refuse(status: int, words: str) -> JSONResponse:
    return JSONResponse({"error": words}, status, CLOSE)


def _has_key(headers: Headers, key: str) -> bool:
    kind, _, given = headers.get("authorization", "").partition(" ")
    if kind.lower() == "basic":
        try:
            given = base64.b64decode(given, validate=True).decode("utf-8", "replace").partition(":")[2]
        except ValueError:
            given = ""
    candidates: list[Any] = [
        headers.get("x-api-key", ""),
        given if kind.lower() in ("basic", "bearer") else "",
    ]
    return any(secrets.compare_digest(each.encode(), key.encode()) for each in candidates)
