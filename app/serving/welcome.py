"""What a person is told when the server begins: where it is, how to get in, and a code for the phone."""

import io

import segno

from app.serving.addresses import Reach

_LIGHT_ON_DARK, _AS_BEFORE = "\033[97;40m", "\033[0m"


def login_link(reach: Reach, key: str) -> str:
    """An address that lets one browser in; the key stands where it is sent to no server and no log."""
    return f"{reach.addresses[0]}/login#key={key}"


def qr_code(link: str) -> segno.QRCode:
    """The link for a camera."""
    return segno.make_qr(link, error="m")


def qr_lines(code: segno.QRCode) -> list[str]:
    """A code drawn with half blocks, light on dark, with the margin that readers need."""
    text = io.StringIO()
    code.terminal(out=text, compact=True, border=3)
    return [f"{_LIGHT_ON_DARK}{line}{_AS_BEFORE}" for line in text.getvalue().splitlines()]


def local_lines(reach: Reach) -> list[str]:
    """For a server that only this machine reaches."""
    return [
        f"Open {reach.addresses[0]} in a browser on this machine. Ctrl-C ends it.",
        "Other devices: `turnscan serve --host 0.0.0.0`, which asks for a password.",
    ]


def network_lines(reach: Reach, fingerprint: str) -> list[str]:
    """For one that the network reaches.

    Args:
        reach: of the server.
        fingerprint: of a certificate that no browser knows; empty where there is none.
    """
    lines = ["Open one of these in a browser:", *(f"  {address}" for address in reach.addresses)]
    if fingerprint:
        lines += [
            "Browsers will warn of the certificate, which this server has signed itself. It is the right one",
            "if they show this SHA-256 fingerprint:",
            f"  {fingerprint}",
        ]
    elif reach.scheme == "http":
        lines.append("Nothing is encrypted: whoever listens in this network can see it. See `--tls`.")
    return lines


def password_lines(password: str, link: str) -> list[str]:
    """Shown once, to whoever sits at the terminal."""
    told = [f"The password is {password} - write it down, it is not shown again."] if password else []
    return [
        *told,
        "A phone gets in with this code, once, within ten minutes:",
        *qr_lines(qr_code(link)),
        link,
    ]


def silent_lines() -> list[str]:
    """Where nobody sits at the terminal, what is said would stay in a file: no password is made."""
    return ["No password is set, so other machines are refused. Set one with `turnscan password`."]
