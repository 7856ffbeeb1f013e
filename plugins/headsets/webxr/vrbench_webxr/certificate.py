"""A certificate that this PC makes for itself, once: the headset's browser asks about it once."""

from __future__ import annotations

import ipaddress
import os
import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path

from vrbench.errors import ConfigError

DAYS = 825
RENEW_DAYS = 30


def folder() -> Path:
    """Where the certificate is kept."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "vrbench" / "webxr"


def context(host: str, certificate: Path | None, key: Path | None) -> ssl.SSLContext:
    """The server's side of TLS, with the lab's certificate or our own.

    Raises:
        ConfigError: a file is missing or is no certificate, or no key to it.
    """
    if (certificate is None) != (key is None):
        raise ConfigError("a certificate and its key go together", field="certificate, key")
    if certificate is None or key is None:
        certificate, key = own(host, folder())
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        tls.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(
            f"can't be used: {error}", file=certificate, fix="PEM files of a certificate and key"
        ) from error
    return tls


def own(host: str, where: Path) -> tuple[Path, Path]:
    """Paths of our own certificate for an address, and of its key; made where there is none."""
    name = host.replace(":", "-")
    certificate, key = where / f"{name}.pem", where / f"{name}.key"
    if not (certificate.exists() and key.exists() and _lasts(certificate)):
        where.mkdir(parents=True, exist_ok=True)
        pem, secret = _make(host)
        _write(key, secret)
        _write(certificate, pem)
    return certificate, key


def _write(path: Path, content: bytes) -> None:
    """Writes a file that nobody else can read, in one step."""
    part = path.with_name(f"{path.name}.{os.getpid()}")
    with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(content)
    part.replace(path)


def _lasts(path: Path) -> bool:
    from cryptography import x509

    try:
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
    except ValueError:
        return False
    left = certificate.not_valid_after_utc - datetime.now(UTC)
    return left > timedelta(days=RENEW_DAYS)


def _make(host: str) -> tuple[bytes, bytes]:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"vrbench {host}")])
    names: list[x509.GeneralName] = [x509.DNSName("localhost")]
    addresses = {"127.0.0.1", "::1"} | ({host} if host != "localhost" else set())
    names += [x509.IPAddress(ipaddress.ip_address(address)) for address in sorted(addresses)]
    now = datetime.now(UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=DAYS))
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(key, hashes.SHA256())
    )
    secret = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    return certificate.public_bytes(serialization.Encoding.PEM), secret
