"""`python -m app.serving.health`: 0 where the server of this machine answers that it is well, else 1."""

import http.client
import ssl
import sys

from app.errors import OptionError
from app.settings import LOOPBACK, Settings, read_settings

PATH = "/healthz"
_TIMEOUT_S = 5.0


def is_healthy(settings: Settings) -> bool:
    """Whether the server with these settings answers, asked on this machine."""
    host = {"0.0.0.0": LOOPBACK, "::": "::1"}.get(settings.host, settings.host)
    connection: http.client.HTTPConnection
    if settings.is_encrypted:
        # It is asked whether it lives, not who it is.
        trusting = ssl.create_default_context()
        trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
        connection = http.client.HTTPSConnection(host, settings.port, timeout=_TIMEOUT_S, context=trusting)
    else:
        connection = http.client.HTTPConnection(host, settings.port, timeout=_TIMEOUT_S)
    try:
        connection.request("GET", PATH, headers={"Host": f"localhost:{settings.port}"})
        return connection.getresponse().status == http.client.OK
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def main() -> int:
    """With the settings of the environment, as Docker asks it."""
    try:
        return 0 if is_healthy(read_settings({})) else 1
    except OptionError:
        return 1


if __name__ == "__main__":
    sys.exit(main())
