"""The scanner over HTTP and WebSocket."""
