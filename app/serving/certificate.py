"""A certificate that the server signs itself: it encrypts, and whoever compares its fingerprint knows it."""

import ipaddress
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import OptionError, OutputError
from app.files import make_folder, write_whole

if TYPE_CHECKING:
    from cryptography import x509

_LASTS = timedelta(days=397)
_RENEWED_BEFORE = timedelta(days=30)
# Clocks of phones are late or early.
_BEGINS_BEFORE = timedelta(days=1)


@dataclass(frozen=True, slots=True)
class Certificate:
    """Files for the server.

    Attributes:
        certificate, key: PEM.
        fingerprint: SHA-256, as browsers show it.
        ends: when it is valid no longer.
    """

    certificate: Path
    key: Path
    fingerprint: str
    ends: datetime


def own_certificate(certificate: Path, key: Path) -> Certificate:
    """One that somebody else has made.

    Raises:
        OptionError: a file is missing, is none, has ended, or they do not belong together.
    """
    from cryptography import x509

    hint = "Give --certificate and --key of one pair, both PEM, the key without a password."
    for file in (certificate, key):
        if not file.is_file():
            raise OptionError(f"There is no file {file}.", hint)
    try:
        # A key with a password would be asked for in the terminal.
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate, key, password="")
        found = x509.load_pem_x509_certificate(certificate.read_bytes())
    except (ssl.SSLError, OSError, ValueError) as error:
        raise OptionError(f"{certificate} and {key} cannot be used ({error}).", hint) from error
    if found.not_valid_after_utc <= datetime.now(UTC):
        raise OptionError(f"{certificate} ended on {found.not_valid_after_utc:%Y-%m-%d}.", "Renew it.")
    return Certificate(certificate, key, fingerprint_of(found), found.not_valid_after_utc)


def self_signed(folder: Path, hosts: Sequence[str]) -> Certificate:
    """The one that is kept in a folder; made anew where it is missing, near its end, or for other hosts.

    Args:
        folder: made where it is missing.
        hosts: names and addresses by which the server may be called.

    Raises:
        OutputError: it cannot be kept.
    """
    made = Path(folder, "certificate.pem"), Path(folder, "key.pem")
    kept = _kept(*made, hosts)
    if kept is None:
        _make(*made, hosts)
        kept = _kept(*made, hosts)
    if kept is None:
        raise OutputError(str(made[0]), "cannot be read back", "Check the disk.")
    return Certificate(*made, fingerprint_of(kept), kept.not_valid_after_utc)


def fingerprint_of(certificate: "x509.Certificate") -> str:
    """SHA-256 of a certificate, as browsers show it."""
    from cryptography.hazmat.primitives.hashes import SHA256

    return certificate.fingerprint(SHA256()).hex(":").upper()


def _kept(certificate: Path, key: Path, hosts: Sequence[str]) -> "x509.Certificate | None":
    """The certificate in the folder, if it still serves."""
    from cryptography import x509

    try:
        found = x509.load_pem_x509_certificate(certificate.read_bytes())
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
        named = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (OSError, ValueError, x509.ExtensionNotFound):
        return None
    if found.not_valid_after_utc - datetime.now(UTC) < _RENEWED_BEFORE:
        return None
    return found if set(named) == set(_names(hosts)) else None


def _make(certificate: Path, key: Path, hosts: Sequence[str]) -> None:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    secret = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Turnscan")])
    now = datetime.now(UTC)
    signed = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(secret.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _BEGINS_BEFORE)
        .not_valid_after(now + _LASTS)
        .add_extension(x509.SubjectAlternativeName(_names(hosts)), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(secret, hashes.SHA256())
    )
    make_folder(certificate.parent)
    private = secret.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    write_whole(key, private, mode=0o600)
    write_whole(certificate, signed.public_bytes(serialization.Encoding.PEM))


def _names(hosts: Sequence[str]) -> "list[x509.GeneralName]":
    from cryptography import x509

    names: list[x509.GeneralName] = []
    for host in dict.fromkeys(hosts):
        try:
            names.append(x509.IPAddress(ipaddress.ip_address(host)))
        except ValueError:
            names.append(x509.DNSName(host))
    return names
