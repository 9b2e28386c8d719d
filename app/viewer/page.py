"""viser's own page, made to fit into ours."""

import gzip
import hashlib
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.resources import files

# In a frame viser's client reconnects only if it believes to have the focus, which it never has there.
_SCRIPT = """<script>{
document.hasFocus = () => document.visibilityState === 'visible';
document.addEventListener('visibilitychange', () => window.dispatchEvent(new Event('focus')));
const classes = document.documentElement.classList;
if (window.parent !== window) classes.add('framed');
if (new URLSearchParams(location.search).get('theme') === 'light') classes.add('light');
}</script>"""
# The page around it decides between dark and light, also where another has asked the scene for the other:
# a frame of another scheme than the page's would not be transparent.
_STYLE = """<style>
html { color-scheme: dark !important; }
html.light { color-scheme: light !important; }
html:not(.framed) { background: radial-gradient(circle at 50% 42%, #2b303a, #111318 75%) fixed; }
html.light:not(.framed) { background: radial-gradient(circle at 50% 42%, #ffffff, #d4d9e1 75%) fixed; }
html.framed, body, #root, #root div { background: transparent !important; }
.mantine-Notifications-root, #root .mantine-Paper-root { display: none !important; }
</style>"""

# Its scripts, workers and pictures are made in the page itself.
CONTENT_POLICY = "; ".join(
    (
        "default-src 'self'",
        "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:",
        "worker-src blob:",
        "connect-src 'self' blob: data:",
        "img-src 'self' data: blob:",
        "style-src 'self' 'unsafe-inline'",
        "font-src 'self' data:",
        "frame-ancestors 'self'",
        "base-uri 'none'",
        "form-action 'none'",
    )
)


@dataclass(frozen=True, slots=True)
class Page:
    """The page in both ways of sending it.

    Attributes:
        plain, gzipped: the same HTML.
        etag: changes with viser's version, because an older page cannot talk to a newer server.
        dialect: the sub-protocol that the page speaks.
    """

    plain: bytes
    gzipped: bytes
    etag: str
    dialect: str


@cache
def viewer_page() -> Page:
    """Read once from viser's package."""
    html = (files("viser") / "client" / "build" / "index.html").read_text("utf-8")
    if html.count("</head>") != 1:
        raise RuntimeError("viser's page is not as it was: it has not got one head")
    plain = html.replace("</head>", f"{_STYLE}{_SCRIPT}</head>").encode()
    digest = hashlib.sha256(plain).hexdigest()[:16]
    dialect = f"viser-v{version('viser')}"
    return Page(plain, gzip.compress(plain, mtime=0), f'"{dialect}-{digest}"', dialect)
