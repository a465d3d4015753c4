"""Events on real sockets: multicast on loopback, TLS with certificates of both ends; what cannot be sent is counted."""

from __future__ import annotations

import asyncio
import shutil
import socket
import ssl
import struct
import subprocess
from pathlib import Path

import pytest

from companion.errors import ConfigError
from companion.tak.links import TlsLink, UdpLink, tls_context

GROUP = "239.2.3.1"
_PATIENCE_S = 30.0


def listener(group: str | None) -> socket.socket:
    """On loopback alone."""
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind((group or "127.0.0.1", 0))
    opened.settimeout(_PATIENCE_S)
    if group is not None:
        member = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton("127.0.0.1"))
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    return opened


@pytest.mark.parametrize("group", [GROUP, None])
def test_a_datagram_holds_one_event(group: str | None) -> None:
    with listener(group) as other:
        link = UdpLink(group or "127.0.0.1", other.getsockname()[1], 0, "127.0.0.1")
        link.send([b"<event/>", b"<other/>"])
        assert [other.recv(4096), other.recv(4096)] == [b"<event/>", b"<other/>"]
        assert (link.sent, link.dropped) == (2, 0)
        link._socket.close()


async def test_what_the_network_does_not_take_is_counted() -> None:
    link = UdpLink(GROUP, 6969, 0, "127.0.0.1")
    link.send([b"x" * 70_000])
    assert (link.sent, link.dropped) == (0, 1)
    running = asyncio.create_task(link.run())
    await asyncio.sleep(0)
    running.cancel()
    await asyncio.wait({running})
    assert link._socket.fileno() == -1


def test_all_of_a_network_can_be_told() -> None:
    link = UdpLink("127.255.255.255", 6969, 1, None)
    link.send([b"<event/>"])
    assert (link.sent, link.dropped) == (1, 0)
    link._socket.close()


def test_an_interface_that_is_none_of_ours_is_told() -> None:
    with pytest.raises(ConfigError, match=r"tak\.interface: 192\.0\.2\.7"):
        UdpLink(GROUP, 6969, 1, "192.0.2.7")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An authority, a server called localhost, a client, and another authority."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl to make certificates with")
    folder = tmp_path_factory.mktemp("certificates")

    def run(*words: str) -> None:
        subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)

    (folder / "names").write_text("subjectAltName=DNS:localhost\n")
    (folder / "ca").write_text("basicConstraints=critical,CA:TRUE\nkeyUsage=critical,keyCertSign,cRLSign\n")
    curve = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    for name in ("authority", "stranger", "server", "client"):
        run("req", "-new", *curve, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}")
    for name in ("authority", "stranger"):
        run("x509", "-req", "-in", f"{name}.csr", "-signkey", f"{name}.key", "-extfile", "ca", "-out", f"{name}.pem")
    for name in ("server", "client"):
        issuer = ("-CA", "authority.pem", "-CAkey", "authority.key", "-CAcreateserial")
        run("x509", "-req", "-in", f"{name}.csr", *issuer, "-extfile", "names", "-out", f"{name}.pem")
    return folder


class TakServer:
    """Takes what clients with a certificate of the authority send."""

    def __init__(self, folder: Path) -> None:
        self.received = b""
        self._context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self._context.load_cert_chain(folder / "server.pem", folder / "server.key")
        self._context.load_verify_locations(folder / "authority.pem")
        self._context.verify_mode = ssl.CERT_REQUIRED
        self._writers: list[asyncio.StreamWriter] = []

    async def listen(self, port: int = 0) -> int:
        self._server = await asyncio.start_server(self._take, "127.0.0.1", port, ssl=self._context)
        chosen = self._server.sockets[0].getsockname()[1]
        assert isinstance(chosen, int)
        return chosen

    async def _take(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        while data := await reader.read(4096):
            self.received += data
        writer.close()

    async def aclose(self) -> None:
        self._server.close()
        for writer in self._writers:
            writer.close()


async def until_received(link: TlsLink, server: TakServer, event: bytes) -> None:
    async with asyncio.timeout(_PATIENCE_S):
        while event not in server.received:
            link.send([event])
            await asyncio.sleep(0.05)


async def test_tls_with_certificates_of_both_ends_and_again_after_the_server_was_gone(certificates: Path) -> None:
    server = TakServer(certificates)
    port = await server.listen()
    context = tls_context(*(certificates / name for name in ("authority.pem", "client.pem", "client.key")))
    link = TlsLink("localhost", port, context)
    link.send([b"<early/>"])
    assert link.dropped == 1
    running = asyncio.create_task(link.run())
    await until_received(link, server, b"<event/>")
    assert link._writer is not None
    tcp = link._writer.get_extra_info("socket")
    # Of a network that is gone the kernel would keep events for half an hour, and send the oldest first.
    assert tcp.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 10_000
    await server.aclose()
    await asyncio.sleep(0.2)
    again = TakServer(certificates)
    await again.listen(port)
    await until_received(link, again, b"<later/>")
    running.cancel()
    await asyncio.wait({running})
    await again.aclose()


async def test_a_server_of_another_authority_gets_nothing(certificates: Path, caplog: pytest.LogCaptureFixture) -> None:
    server = TakServer(certificates)
    port = await server.listen()
    link = TlsLink(
        "localhost", port, tls_context(*(certificates / n for n in ("stranger.pem", "client.pem", "client.key")))
    )
    running = asyncio.create_task(link.run())
    async with asyncio.timeout(_PATIENCE_S):
        while "verify failed" not in caplog.text:
            link.send([b"<secret/>"])
            await asyncio.sleep(0.02)
    running.cancel()
    await asyncio.wait({running})
    assert server.received == b"" and link.sent == 0
    await server.aclose()


@pytest.mark.parametrize(
    ("files", "key"),
    [
        (("none.pem", "client.pem", "client.key"), "ca_file"),
        (("authority.key", "client.pem", "client.key"), "ca_file"),
        (("authority.pem", "client.pem", "server.key"), "cert_file"),
    ],
)
def test_files_that_do_not_fit_are_told_by_their_key(certificates: Path, files: tuple[str, ...], key: str) -> None:
    with pytest.raises(ConfigError, match=rf"tak\.{key}: .*PEM"):
        tls_context(*(certificates / name for name in files))
