"""Who may see the page and who may control the run: address, token, and where a request is from.

The page is served on loopback by default. There, every user can view it; from another
computer, only users with the token. To control a run always needs the token. A browser that
was lured elsewhere is kept out by the names that it sends (Host) and by the page that asks
(Origin).
"""

import hmac
import ipaddress
import secrets
import socket
import stat
from dataclasses import dataclass
from pathlib import Path

from stepdiag_ros.metrology.refusal import Refusal

LEAST_TOKEN = 16
"""Characters of a token, at least; one that is made here has 32."""


@dataclass(frozen=True)
class PageAccess:
    """What is asked of a request.

    Attributes:
        address: that the page is served on.
        token: that control always needs, and viewing from elsewhere.
        made: the token was made at start, and is shown to the user who has started this.
    """

    address: str
    token: str
    made: bool

    @property
    def is_local(self) -> bool:
        """Say whether nobody but this computer can reach the page."""
        return is_loopback(self.address)

    def knows(self, token: str) -> bool:
        """Return whether a token is right, in a time that does not depend on how much of it is."""
        # JSON and headers may hold halves of characters, which no other encoding takes.
        return hmac.compare_digest(token.encode(errors="surrogatepass"), self.token.encode())

    def may_view(self, token: str) -> bool:
        """Return whether a client with this token (empty: none) may see the state."""
        return self.is_local or self.knows(token)

    def refuses_host(self, host: str) -> bool:
        """Say whether a request was sent to a name that is not ours (DNS rebinding).

        Args:
            host: header Host: a name or an address, perhaps with a port.
        """
        name = _without_port(host)
        if is_loopback(name):
            return False
        if self.is_local:
            return True
        try:
            # Nobody can point an address elsewhere, as one can a name.
            ipaddress.ip_address(name)
        except ValueError:
            own = {self.address, socket.gethostname(), socket.getfqdn()}
            return name.lower() not in {one.lower() for one in own}
        return False

    @staticmethod
    def refuses_origin(origin: str | None, host: str) -> bool:
        """Say whether another site's page asks.

        Args:
            origin: header Origin; None if missing, as browsers never do for WebSockets.
            host: header Host.
        """
        return origin is not None and origin.lower() not in (f"http://{host}".lower(),)


def is_loopback(address: str) -> bool:
    """Say whether an address or a name stands for this computer alone."""
    if address.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


def make_access(address: str, token_file: str) -> PageAccess:
    """Return the rules for an address.

    Args:
        address: to be served on.
        token_file: whose first line is the token; empty: one is made, on loopback only.

    Raises:
        ValueError: others can reach the address and there is no token, or the token is too short,
            or others can read it.
        OSError: the file cannot be read.
    """
    if token_file:
        return PageAccess(address, _read_token(Path(token_file)), made=False)
    if not is_loopback(address):
        raise Refusal(
            f"other computers can reach the address '{address}': give a file with a token too"
            f" (--token-file, parameter token_file), which holds {LEAST_TOKEN} characters or more"
            " and which only you can read",
            fault="exposed",
        )
    return PageAccess(address, secrets.token_hex(LEAST_TOKEN), made=True)


def _read_token(path: Path) -> str:
    if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise Refusal(
            f"{path}: others can read the token: run chmod 600 on the file", fault="exposed"
        )
    token = path.read_text(encoding="utf-8").partition("\n")[0].strip()
    if len(token) < LEAST_TOKEN or not token.isascii() or not token.isprintable():
        raise Refusal(
            f"{path}: the token in the first line must have {LEAST_TOKEN} plain characters or more",
            fault="too_few",
        )
    return token


def _without_port(host: str) -> str:
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if host.count(":") == 1 else host
