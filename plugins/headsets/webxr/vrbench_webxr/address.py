"""What a person is told: where the page is, and how the headset gets there."""

from __future__ import annotations

import io
import socket
import sys

from vrbench_webxr.options import Options


def address(options: Options, port: int, token: str) -> str:
    """The page's address, as the headset's browser should open it."""
    scheme = "https" if options.https else "http"
    host = "localhost" if options.loopback else _reachable(options.host)
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}/{token}/"


def told(options: Options, port: int, url: str) -> str:
    """The address for the terminal: by cable where it is loopback, else with a QR code."""
    lines = ["", "  Open this in the headset's browser and press Start:", "", f"    {url}", ""]
    if options.loopback:
        lines += [f"  by cable, first: adb reverse tcp:{port} tcp:{port}", ""]
    elif options.https:
        lines += [
            "  the browser warns of a certificate that this PC made for itself: Advanced, Proceed",
            "",
        ]
    if not options.loopback:
        lines.append(qr_code(url))
    return "\n".join(lines) + "\n"


def show(text: str) -> None:
    """Writes to the terminal, beside what a command prints as its result."""
    sys.stderr.write(text)
    sys.stderr.flush()


def qr_code(url: str) -> str:
    """A QR code in half blocks, as a terminal shows it."""
    import segno

    out = io.StringIO()
    segno.make(url, error="m", micro=False).terminal(out=out, compact=True, border=2)
    return out.getvalue()


def _reachable(host: str) -> str:
    """The address that others reach this PC by, where it listens at all of them."""
    if host not in ("0.0.0.0", "::"):
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # nothing is sent: this only chooses a way out
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])
