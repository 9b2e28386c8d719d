"""A network camera on this machine, with the manners of the real ones and their faults."""

import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from scripted_camera import noise_picture

from app.recording.picture import encode

_BOUNDARY = "--frame"


class PictureServer(ThreadingHTTPServer):
    """Serves `/video` as a stream, `/shot.jpg` as single pictures, and more.

    Attributes:
        tells_length: whether parts carry their length.
        is_silent: it keeps the connection and sends nothing.
        cuts: it sends half of the next picture and closes.
        is_gone: it closes every connection.
        password: the Authorization header that it wants.
    """

    daemon_threads = True

    def __init__(self, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.tells_length, self.is_silent, self.cuts, self.is_gone = True, False, False, False
        self.boundary = _BOUNDARY
        self.period_s = 0.01
        self.password = ""
        self.asked: list[str] = []
        self.served = 0
        self._thread = threading.Thread(target=self.serve_forever, args=(0.01,), name="picture-server")
        self._thread.start()

    @property
    def port(self) -> int:
        return int(self.server_address[1])

    def url(self, path: str = "/video") -> str:
        return f"http://127.0.0.1:{self.port}{path}"

    def picture(self) -> bytes:
        self.served += 1
        return encode(noise_picture(self.served), "jpeg")

    def stop(self) -> None:
        self.is_gone = True
        self.shutdown()
        self.server_close()
        self._thread.join()


class _Handler(BaseHTTPRequestHandler):
    server: PictureServer

    def log_message(self, *_: object) -> None:
        """Tests have no log."""

    def do_GET(self) -> None:
        server = self.server
        server.asked.append(self.path)
        if server.is_gone:
            return
        if server.password and self.headers.get("Authorization") != server.password:
            self.send_error(401)
            return
        path = self.path.partition("?")[0]
        if path == "/video":
            self._stream()
        elif path == "/shot.jpg":
            self._send("image/jpeg", server.picture())
        elif path == "/":
            self._send("text/html", b"<html>Welcome to your camera</html>")
        elif path == "/sound":
            self._send("audio/wav", b"RIFF")
        elif path == "/moved":
            self.send_response(302)
            self.send_header("Location", "/video")
            self.end_headers()
        elif path == "/round":
            self.send_response(302)
            self.send_header("Location", "/round")
            self.end_headers()
        elif path == "/busy":
            self.send_error(503)
        else:
            self.send_error(404)

    def _send(self, kind: str, data: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def _stream(self) -> None:
        server = self.server
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={server.boundary}")
        self.end_headers()
        try:
            while not server.is_gone:
                time.sleep(server.period_s)
                if server.is_silent:
                    continue
                data = server.picture()
                length = f"Content-Length: {len(data)}\r\n" if server.tells_length else ""
                head = f"\r\n--{server.boundary.strip('-')}\r\nContent-Type: image/jpeg\r\n{length}\r\n"
                if server.cuts:
                    server.cuts = False
                    self.wfile.write(head.encode() + data[: len(data) // 2])
                    return
                self.wfile.write(head.encode() + data)
        except OSError:
            return
