"""The scanner over HTTP and WebSocket, at `/api/v1`."""
