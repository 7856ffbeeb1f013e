"""Where a device that is listened for is heard."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from vrbench.devices.listening import Listening


@pytest.mark.parametrize(
    ("text", "host", "port", "loopback"),
    [
        ("127.0.0.1:9750", "127.0.0.1", 9750, True),
        ("192.168.1.5:0", "192.168.1.5", 0, False),
        ("localhost:65535", "localhost", 65535, True),
        ("[::1]:8765", "::1", 8765, True),
        ("0.0.0.0:8765", "0.0.0.0", 8765, False),
    ],
)
def test_an_address_and_a_port_are_told_apart(text, host, port, loopback):
    found = Listening(listen=text)
    assert (found.host, found.port, found.loopback) == (host, port, loopback)


@pytest.mark.parametrize("text", ["8765", "127.0.0.1", "a.host:8765", "127.0.0.1:65536", "1.2.3:²"])
def test_what_is_no_address_of_this_computer_is_refused(text):
    with pytest.raises(ValidationError, match=r"an address of this computer and a port, as 192"):
        Listening(listen=text)
