"""Who may look at a server of this machine: programs, and pages of Foxglove and of this machine; no page of elsewhere.

A browser leads any page to any port of its machine, and says where the page is from (RFC 6455, 10.2). The SDK's server
doesn't ask; so it listens at an address of the loopback network that nobody can guess, and this gate before it, in a
process of its own: what a viewer takes costs the session's loop nothing.

This file runs by itself, with Python's own modules alone.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import secrets
import socket
import subprocess
import sys

LOOPBACK = "127.0.0.1"
#: pages that may connect: Foxglove's own, its application's, and those of this machine
ORIGINS = re.compile(r"https://(app|studio)\.foxglove\.dev|file://|https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?")
#: a request's head comes within so long [s]
PATIENCE = 5.0
#: bytes that are handed on at once
CHUNK = 1 << 16


def hidden_address() -> str:
    """A loopback address that isn't guessed; the usual one where the machine has no other."""
    address = f"127.{secrets.randbelow(254) + 1}.{secrets.randbelow(256)}.{secrets.randbelow(254) + 1}"
    try:
        with socket.create_server((address, 0)):
            return address
    except OSError:
        return LOOPBACK


def refusal(head: str, port: int) -> str | None:
    """Why a request is refused, by its head; None where it isn't."""
    fields = dict[str, list[str]]()
    for line in head.split("\r\n")[1:]:
        name, _, value = line.partition(":")
        fields.setdefault(name.strip().lower(), []).append(value.strip())
    # a page of elsewhere may lead a browser here under another name (DNS rebinding)
    if fields.get("host") not in ([f"{LOOPBACK}:{port}"], [f"localhost:{port}"]):
        return "this server is for its own machine"
    origin = fields.get("origin", [])
    if origin and (len(origin) > 1 or not ORIGINS.fullmatch(origin[0])):
        return "pages of elsewhere may not look"
    return None


class Gate:
    """A port of this machine, whose visitors are let through to a server.

    Args:
        port: 0 chooses a free one.

    Attributes:
        port: that visitors come to.

    Raises:
        OSError: the port is taken.
    """

    def __init__(self, port: int) -> None:
        self._socket = socket.create_server((LOOPBACK, port))
        self.port = int(self._socket.getsockname()[1])
        self._process: subprocess.Popen[bytes] | None = None

    def open(self, host: str, port: int) -> None:
        """Let visitors through to this address."""
        number = self._socket.fileno()
        command = [sys.executable, "-I", __file__, str(number), host, str(port)]
        # it ends with its standard input, however this process ends; Ctrl-C is this process' own
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=[number], start_new_session=True)
        self._socket.close()

    def close(self) -> None:
        """Let nobody in any more."""
        self._socket.close()
        if self._process is not None:
            with self._process:
                self._process.kill()


async def _pass(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(CHUNK):
            writer.write(data)
            await writer.drain()
    writer.close()


async def _serve(number: int, host: str, port: int) -> None:
    listening = socket.socket(fileno=number)
    own = listening.getsockname()[1]

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), PATIENCE)
            says = refusal(head.decode("latin-1"), own)
            if says is None:
                server, to = await asyncio.open_connection(host, port)
                to.write(head)
                await asyncio.gather(_pass(reader, to), _pass(server, writer))
            else:
                body = f"HTTP/1.1 403 Forbidden\r\nContent-Length: {len(says)}\r\nConnection: close\r\n\r\n{says}"
                writer.write(body.encode())
                await writer.drain()
        except (OSError, EOFError, asyncio.LimitOverrunError):
            pass  # whoever came has gone, or spoke no HTTP
        writer.close()

    async with await asyncio.start_server(answer, sock=listening):
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)


if __name__ == "__main__":
    asyncio.run(_serve(int(sys.argv[1]), sys.argv[2], int(sys.argv[3])))
