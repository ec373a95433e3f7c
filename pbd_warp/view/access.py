"""Who may talk to the server: names it goes by, origins of pages, the token in its address."""

from __future__ import annotations

import contextlib
import secrets
import socket
from collections.abc import Sequence
from ipaddress import ip_address

from pbd_warp.errors import InputError


class Access:
    """The rules of one server.

    A page from elsewhere in the same browser can send requests here under a name of its own that it lets point to
    this machine (DNS rebinding), or under ours with its own Origin. So the Host header must name this server and its
    port, and a conversation needs the Origin that goes with it. Who knows the token, which no such page can, may come
    under any name: behind a tunnel the browser knows another one.

    Args:
        host: What the server is bound to. Unless it is a loopback address, there is a token.
        also: Other names (with port, unless 80 or 443) under which it is reached.
        token: Whether there is a token in any case.

    Attributes:
        port: To be set once it is known.
        path: What all paths begin with.

    Raises:
        InputError: a name with a scheme or a path.
    """

    def __init__(self, host: str, also: Sequence[str] = (), token: bool = False):
        for name in also:
            if not name or set(name) & set("/ @?#"):
                raise InputError(f"a host is NAME or NAME:PORT, as browsers show it, not {name!r}")
        self.host, self.port = host, 0
        self.loopback = host == "localhost" or _is_address(bracketed(host), loopback=True)
        self._also = {name.lower() for name in also}
        self._has_token = token or not self.loopback
        self.path = f"/{secrets.token_urlsafe(16)}/" if self._has_token else "/"

    def refusal(self, path: str, hosts: Sequence[str]) -> str | None:
        """Why a request is refused, None if it is not."""
        with_token = secrets.compare_digest(path[: len(self.path)].encode(), self.path.encode())
        if self._has_token and with_token and len(hosts) == 1 and hosts[0]:
            return None
        if len(hosts) != 1 or not (self._is_ours(hosts[0]) or hosts[0].lower() in self._also):
            return "This server does not go by that name. Behind a tunnel: pbd-warp view --allow-host NAME:PORT\n"
        return None if with_token else "The address lacks the token that was printed with it.\n"

    def is_own_origin(self, origins: Sequence[str], host: str) -> bool:
        """Whether a conversation is begun by a page of this server, as which it was asked for by `host`."""
        schemes = ("http",) if self._is_ours(host) else ("http", "https")  # tunnels often encrypt
        own = {f"{scheme}://{host.lower()}" for scheme in schemes}
        own |= {f"{scheme}://{name}" for scheme in ("http", "https") for name in self._also}
        return len(origins) == 1 and origins[0].lower() in own

    def urls(self) -> list[str]:
        """Addresses of the page, for this machine first, then those that others can use."""
        if self.host not in ("0.0.0.0", "::"):
            return [f"http://{bracketed(self.host)}:{self.port}{self.path}"]
        here = "127.0.0.1" if self.host == "0.0.0.0" else "[::1]"
        names = [here, *(bracketed(address) for address in own_addresses(self.host))]
        return [f"http://{name}:{self.port}{self.path}" for name in names]

    def _is_ours(self, host: str) -> bool:
        name, colon, port = host.rpartition(":")
        if not colon or not (port.isascii() and port.isdigit() and len(port) <= 5):
            name, port = host, "80"
        if int(port) != self.port:
            return False
        name = name.lower()
        if name in ("localhost", bracketed(self.host).lower()) or _is_address(name, loopback=True):
            return True
        # Bound to all addresses, which one a page has used is not known; names can be anybody's, addresses cannot.
        return not self.loopback and (name == socket.gethostname().lower() or _is_address(name, loopback=False))


def own_addresses(host: str) -> list[str]:
    """Addresses of this machine that others can use, of the family of "0.0.0.0" or "::"; the one it goes out by first.

    Nothing is sent: a UDP socket only asks which way it would go.
    """
    found: list[str] = []
    family, elsewhere = (socket.AF_INET, "192.0.2.1") if host == "0.0.0.0" else (socket.AF_INET6, "2001:db8::1")
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as asking:
        asking.connect((elsewhere, 9))
        found.append(asking.getsockname()[0])
    with contextlib.suppress(OSError):
        found += [str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None, family)]
    usable = [address for address in found if not ip_address(address.partition("%")[0]).is_loopback]
    return list(dict.fromkeys(usable))


def _is_address(name: str, *, loopback: bool) -> bool:
    """Whether a name as in a URL is an IP address; with `loopback`, of this machine alone."""
    try:
        address = ip_address(name[1:-1] if name.startswith("[") and name.endswith("]") else name)
    except ValueError:
        return False
    return address.is_loopback or not loopback


def bracketed(host: str) -> str:
    """An address as it stands in a URL."""
    return f"[{host}]" if ":" in host else host
