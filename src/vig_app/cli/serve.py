"""`vig serve`: photos explained over HTTP."""

import json
import os
import socket
from contextlib import suppress

import uvicorn

from vig.io.errors import UserError
from vig_app.cli.common import ServeCommand
from vig_app.server.app import Service, app_of


def serve(settings: ServeCommand) -> int:
    """Serve until interrupted; returns the exit code."""
    host, key = settings.host, settings.key or os.environ.get("VIG_KEY")
    if key is None and host not in ("127.0.0.1", "localhost", "::1"):
        raise UserError(f"expected --key with --host {host}, which others reach; got none. Choose one.")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, settings.port), family=family)
    except (OSError, OverflowError, UnicodeError) as error:
        reason = str(getattr(error, "strerror", None) or error).rstrip(".")
        raise UserError(f"cannot listen at {host}, port {settings.port}: {reason}. Name another.") from None
    token = os.environ.get("LABEL_STUDIO_API_KEY")
    service = Service(tuple(settings.object_class.split(",")), settings.label_studio, token)
    app = app_of(service, key=key, most_bytes=round(settings.megabytes * 1e6), per_minute=settings.per_minute)
    address = f"http://{f'[{host}]' if ':' in host else host}:{listening.getsockname()[1]}"
    if settings.json:
        print(json.dumps({"address": address, "classes": [*service.explainers]}), flush=True)
    else:
        print(
            f"{address}/docs describes it; curl -F photo=@photo.jpg {address}/explain; Ctrl-C ends",
            flush=True,
        )
    config = uvicorn.Config(app, log_level="warning", limit_concurrency=200, server_header=False)
    with suppress(KeyboardInterrupt):  # it ends in no other way
        uvicorn.Server(config).run(sockets=[listening])
    return 0
