"""Limits of requests, before much of them is read: their origin, key, rate, size and time."""

import asyncio
import base64
import secrets
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from fastapi import HTTPException
from fastapi.responses import JSONResponse
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from vig_app.viewer.server import is_own_host

CLOSE = {"Connection": "close"}


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
    minute: int = 0
    requests: Counter[str] = field(default_factory=Counter)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or let the application do so."""
        size, more, until = 0, True, time.monotonic() + self.seconds

        async def limited() -> Message:
            nonlocal size, more
            try:
                wait = until - time.monotonic() if more else None
                message = await asyncio.wait_for(receive(), wait)
            except TimeoutError:
                words = f"expected the whole request within {self.seconds:g} s; got a part."
                raise HTTPException(408, words, CLOSE) from None
            size += len(message.get("body", b""))
            more = message.get("more_body", False)
            self._check_size(size)
            return message

        try:
            if scope["type"] == "http":
                self._check(scope, Headers(scope=scope))
        except HTTPException as error:
            await JSONResponse({"error": error.detail}, error.status_code, error.headers)(
                scope, receive, send
            )
        else:
            await self.app(scope, limited if scope["type"] == "http" else receive, send)

    def _check(self, scope: Scope, headers: Headers) -> None:
        """Raise HTTPException for a request that is refused by its headers."""
        origin, host = headers.get("origin"), headers.get("host", "")
        if (origin and urlsplit(origin).netloc != host) or (self.key is None and not is_own_host(host)):
            raise HTTPException(403, "expected a request of no page of another site; got one.", CLOSE)
        if self.key is not None and scope["path"] != "/health" and not _has_key(headers, self.key):
            raise HTTPException(
                401, "expected the key of vig serve as X-API-Key; got none or another.", CLOSE
            )
        minute, second = divmod(time.monotonic(), 60)
        if minute != self.minute:
            self.minute, self.requests = int(minute), Counter()
        self.requests[client := (scope["client"] or [""])[0]] += 1
        if self.requests[client] > self.per_minute:
            words = f"expected {self.per_minute} requests a minute at most; got more."
            raise HTTPException(429, words, CLOSE | {"Retry-After": str(60 - int(second))})
        length = headers.get("content-length", "0")
        self._check_size(int(length) if length.isdecimal() else self.most_bytes + 1)

    def _check_size(self, size: int) -> None:
        if size > self.most_bytes:
            words = f"expected at most {self.most_bytes:,} bytes; got more. Send a smaller photo."
            raise HTTPException(413, words, CLOSE)


def _has_key(headers: Headers, key: str) -> bool:
    kind, _, given = headers.get("authorization", "").partition(" ")
    if kind.lower() == "basic":
        with suppress(ValueError):
            given = base64.b64decode(given, validate=True).decode().partition(":")[2]
    candidates = headers.get("x-api-key", ""), given
    return any(secrets.compare_digest(each.encode(), key.encode()) for each in candidates)
