"""`vig serve`: photos explained over HTTP."""

from __future__ import annotations

import json
import os
from ipaddress import ip_address

import uvicorn

from vig.io.errors import UserError
from vig_app.cli.common import ServeCommand
from vig_app.server.app import Service, app_of


def serve(settings: ServeCommand) -> int:
    """Serve until interrupted; returns the exit code."""
    key = settings.key or os.environ.get("VIG_KEY")
    if key is None and not ip_address(settings.host).is_loopback:
        raise UserError(
            f"expected --key with --host {settings.host}, which others reach; got none. Choose one."
        )
    token = os.environ.get("LABEL_STUDIO_API_KEY")
    service = Service(tuple(settings.object_class.split(",")), settings.label_studio, token)
    app = app_of(service, key=key, most_bytes=round(settings.megabytes * 1e6), per_minute=settings.per_minute)
    address = f"http://{settings.host}:{settings.port}"
    if settings.json:
        print(json.dumps({"address": address, "classes": [*service.explainers]}), flush=True)
    else:
        print(
            f"{address}/docs describes it; curl -F photo=@photo.jpg {address}/explain; Ctrl-C ends",
            flush=True,
        )
    config = uvicorn.Config(
        app, settings.host, settings.port, log_level="warning", timeout_keep_alive=5, limit_concurrency=200,
        server_header=False,
    )  # fmt: skip
    try:
        uvicorn.Server(config).run()
    except SystemExit:  # uvicorn's, where it cannot listen
        raise UserError(f"expected a free port; got {settings.port}, which is taken. Name another.") from None
    return 0
