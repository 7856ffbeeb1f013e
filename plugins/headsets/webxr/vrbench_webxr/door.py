"""Who may come in: the page's files over HTTP, and which connections become WebSockets."""

from __future__ import annotations

import ipaddress
import secrets
from http import HTTPStatus
from importlib.resources import files
from typing import Any
from urllib.parse import urlsplit

from vrbench.devices.link import Link
from vrbench.devices.ports import HostClock

PAGE = {
    "": ("index.html", "text/html; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
    "icon.svg": ("icon.svg", "image/svg+xml"),
}
HEADERS = {
    # with these two, performance.now() has steps of 5 us instead of 100
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Embedder-Policy": "require-corp",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'",
    "Permissions-Policy": "xr-spatial-tracking=(self)",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class Door:
    """Answers requests before they are WebSockets; nothing without the token of the address.

    Args:
        link: told of everybody who is sent away.
        host: the recorder's clock.
        token: the secret part of the address.
        scheme: `http` or `https`, of the pages whose connections are let through.
    """

    def __init__(self, link: Link, host: HostClock, token: str, scheme: str) -> None:
        self._link, self._host, self._token, self._scheme = link, host, token, scheme

    def answer(self, connection: Any, request: Any) -> Any:
        """Files of the page; None lets a WebSocket through."""
        token, _, rest = request.path.partition("?")[0].lstrip("/").partition("/")
        if not self._own_name(request.headers.get("Host", "")):
            return self._refuse(connection, HTTPStatus.MISDIRECTED_REQUEST, "another host's name")
        if not secrets.compare_digest(token.encode(), self._token.encode()):
            return self._refuse(connection, HTTPStatus.FORBIDDEN, "an address without its token")
        if rest == "ws":
            if not self._own_origin(request.headers):
                return self._refuse(connection, HTTPStatus.FORBIDDEN, "a page of another origin")
            return None
        if rest not in PAGE or not request.path.startswith(f"/{token}/"):
            return self._response(connection, HTTPStatus.NOT_FOUND, b"not here\n", "text/plain")
        name, kind = PAGE[rest]
        body = (files("vrbench_webxr") / "page" / name).read_bytes()
        return self._response(connection, HTTPStatus.OK, body, kind)

    def _own_name(self, host: str) -> bool:
        """Whether the host is named by address: a name of somebody else's may point here."""
        name = urlsplit(f"//{host}").hostname or ""
        if name == "localhost":
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    def _own_origin(self, headers: Any) -> bool:
        """Whether the page is ours; what is no browser sends no origin."""
        origins = headers.get_all("Origin")
        return all(origin == f"{self._scheme}://{headers.get('Host')}" for origin in origins)

    def _refuse(self, connection: Any, status: HTTPStatus, why: str) -> Any:
        self._link.on_refused(self._host.now(), why)
        text = f"refused: {why}. Open the address that vrbench printed.\n"
        return self._response(connection, status, text.encode(), "text/plain; charset=utf-8")

    def _response(self, connection: Any, status: HTTPStatus, body: bytes, kind: str) -> Any:
        response = connection.respond(status, "")
        response.body = body
        for name in ("Content-Type", "Content-Length"):
            del response.headers[name]
        response.headers["Content-Type"] = kind
        response.headers["Content-Length"] = str(len(body))
        for name, value in HEADERS.items():
            response.headers[name] = value
        return response
