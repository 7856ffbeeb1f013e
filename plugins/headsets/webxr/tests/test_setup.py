"""What a person meets first: the address, the certificate, what `vrbench rig check` says."""

import ipaddress
import re
import ssl
import subprocess
import sys
import threading
import tomllib
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pluggy
import pytest
import vrbench_webxr
from cryptography import x509
from pydantic import ValidationError
from vrbench_webxr.address import address, qr_code, told
from vrbench_webxr.certificate import context, own
from vrbench_webxr.emulator import FakePage, play
from vrbench_webxr.options import Options
from vrbench_webxr.route import HEADSET, check
from vrbench_webxr.server import ALPHABET, TOKEN_LENGTH, new_token

from vrbench.devices.host import RealClock
from vrbench.devices.ports import Session
from vrbench.errors import ConfigError
from vrbench.geometry import Transform

HERE = Path(__file__).parents[1]


def session():
    return Session(RealClock(), Transform.identity(), seed=0)


def test_the_hook_gives_the_route_alone():
    manager = pluggy.PluginManager("vrbench")
    manager.register(vrbench_webxr, "webxr")
    ((route,),) = manager.hook.vrbench_headsets()
    assert route is HEADSET
    assert route.profile is None
    project = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"] == {"vrbench": {"webxr": vrbench_webxr.__name__}}


def test_listing_the_plugin_loads_no_server():
    code = (
        "import sys, vrbench_webxr; vrbench_webxr.vrbench_headsets();"
        "sys.exit(bool({'websockets', 'cryptography', 'segno'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("listen", "tls", "url"),
    [
        ("127.0.0.1:8765", None, "http://localhost:8765/secret/"),
        ("localhost:8765", True, "https://localhost:8765/secret/"),
        ("[::1]:8765", None, "http://localhost:8765/secret/"),
        ("192.168.1.5:8765", None, "https://192.168.1.5:8765/secret/"),
        ("192.168.1.5:8765", False, "http://192.168.1.5:8765/secret/"),
        ("[fd00::5]:8765", None, "https://[fd00::5]:8765/secret/"),
    ],
)
def test_the_address_is_one_that_a_headset_can_open(listen, tls, url):
    options = Options(listen=listen, tls=tls)
    assert address(options, options.port, "secret") == url


def test_all_addresses_of_this_pc_are_told_as_one_of_them():
    url = address(Options(listen="0.0.0.0:8765"), 8765, "secret")
    host = ipaddress.ip_address(url.split("/")[2].split(":")[0])
    assert not host.is_unspecified


def test_by_cable_the_command_is_told_and_by_wifi_a_qr_code():
    cable = told(Options(), 8765, "http://localhost:8765/secret/")
    assert "adb reverse tcp:8765 tcp:8765" in cable
    assert "\u2588" not in cable
    url = "https://192.168.1.5:8765/secret/"
    wifi = told(Options(listen="192.168.1.5:8765"), 8765, url)
    assert url in wifi
    assert qr_code(url) in wifi
    assert "certificate" in wifi
    # a QR code of 25 modules and its border, two rows of modules in a line of text
    assert len(qr_code(url).splitlines()) >= 14


def test_tokens_are_typed_without_doubt_and_drawn_anew():
    tokens = {new_token() for _ in range(100)}
    assert len(tokens) == 100
    assert all(re.fullmatch(f"[{ALPHABET}]{{{TOKEN_LENGTH}}}", token) for token in tokens)
    assert not set("01ilo") & set(ALPHABET)


@pytest.mark.parametrize(
    "options",
    [
        {"listen": "8765"},
        {"listen": "example.org:8765"},
        {"listen": "127.0.0.1:http"},
        {"listen": "127.0.0.1:99999"},
        {"token": "short"},
        {"token": "../../../etc"},
        {"rate_hz": 0},
        {"port": 8765},
    ],
)
def test_options_that_make_no_sense_are_refused(options):
    with pytest.raises(ValidationError):
        Options(**options)


def test_our_certificate_is_for_this_address_and_nobody_else_reads_its_key(tmp_path):
    certificate, key = own("192.168.1.5", tmp_path)
    made = x509.load_pem_x509_certificate(certificate.read_bytes())
    names = made.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert "localhost" in names.get_values_for_type(x509.DNSName)
    assert ipaddress.ip_address("192.168.1.5") in names.get_values_for_type(x509.IPAddress)
    assert made.not_valid_after_utc > datetime.now(UTC) + timedelta(days=700)
    assert key.stat().st_mode & 0o077 == 0
    assert own("192.168.1.5", tmp_path) == (certificate, key)
    assert x509.load_pem_x509_certificate(certificate.read_bytes()) == made
    ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)


def test_a_certificate_that_is_spoilt_is_made_anew(tmp_path):
    certificate, key = own("192.168.1.5", tmp_path)
    certificate.write_text("spoilt")
    own("192.168.1.5", tmp_path)
    ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)


def test_a_labs_certificate_that_is_none_is_named(tmp_path):
    pem = tmp_path / "lab.pem"
    pem.write_text("nothing")
    with pytest.raises(ConfigError, match=r"lab\.pem: can't be used"):
        context("localhost", pem, pem)
    with pytest.raises(ConfigError, match="a certificate and its key go together"):
        context("localhost", pem, None)


# vrbench rig check


def test_rig_check_says_that_nobody_came_and_where_to_go():
    served, missing = check(Options(listen="127.0.0.1:0", quiet=True, wait_s=0.05), session())
    assert served.ok
    url = served.what.rsplit(" ", 1)[1]
    assert not missing.ok
    assert missing.what == "no headset is connected"
    assert missing.fix == f"open {url} in its browser"


def test_rig_check_tells_what_the_headset_gives(monkeypatch):
    monkeypatch.setattr("vrbench_webxr.route.WATCH_S", 0.5)
    findings = check(Options(listen="127.0.0.1:0", quiet=True, wait_s=10.0), session())
    url = next(findings).what.rsplit(" ", 1)[1]
    over = threading.Event()
    with FakePage(url) as page:
        page.begin_session(90.0)
        player = threading.Thread(target=play, args=(page, 90.0, lambda: not over.is_set()))
        player.start()
        try:
            told_of = [finding.what for finding in findings]
        finally:
            over.set()
            player.join()
    assert told_of[0] == "a session runs: vrbench emulator"
    assert told_of[1] == "granted: local, local-floor, viewer"
    assert "of 90 frames a second" in told_of[2]
    assert told_of[3] == "100% of frames tracked"
    assert told_of[4].startswith("clock known to ")


def test_rig_check_says_that_a_port_is_in_use(headset):
    port = headset.url.rsplit(":", 1)[1].split("/")[0]
    (only,) = check(Options(listen=f"127.0.0.1:{port}", quiet=True), session())
    assert not only.ok
    assert "can't listen" in only.what
