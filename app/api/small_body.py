"""Bodies of requests by strangers: small, and soon there."""

import asyncio

from starlette.types import Message, Receive

SMALL_BYTES = 16_384
_PATIENCE_S = 20.0


async def read_small(receive: Receive) -> Receive | None:
    """The body, read as a whole; nothing where it is too large or does not come."""
    body = bytearray()
    try:
        async with asyncio.timeout(_PATIENCE_S):
            while True:
                message = await receive()
                if message["type"] == "http.disconnect":
                    return None
                body += message.get("body", b"")
                if len(body) > SMALL_BYTES:
                    return None
                if not message.get("more_body", False):
                    break
    except TimeoutError:
        return None
    is_told = False

    async def receiving() -> Message:
        nonlocal is_told
        if is_told:
            return await receive()
        is_told = True
        return {"type": "http.request", "body": bytes(body), "more_body": False}

    return receiving
