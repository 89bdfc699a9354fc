# SPDX-License-Identifier: MIT
"""Nothing listens to the network but Meshcat, and that to this computer alone."""

from __future__ import annotations

import ipaddress
import re
import struct
import urllib.parse
from pathlib import Path

import pytest

from physim_drake.episodes.runner import local_meshcat

ROOT = Path(__file__).resolve().parents[2]
LISTENING = "0A"


def listening_addresses(port: int) -> set[str]:
    """The addresses at which this computer listens on a port, by the kernel."""
    found = set()
    for name in ("tcp", "tcp6"):
        path = Path("/proc/net") / name
        for line in path.read_text().splitlines()[1:] if path.exists() else ():
            place, state = line.split()[1], line.split()[3]
            address, _, number = place.rpartition(":")
            if state == LISTENING and int(number, 16) == port:
                words = [address[k : k + 8] for k in range(0, len(address), 8)]
                data = b"".join(struct.pack("=I", int(word, 16)) for word in words)
                found.add(str(ipaddress.ip_address(data)))
    return found


def port_of(url: str) -> int:
    port = urllib.parse.urlparse(url).port
    assert port is not None
    return port


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="needs Linux")
def test_meshcat_listens_on_the_loopback_alone_unless_told_otherwise() -> None:
    local, public = local_meshcat(), local_meshcat("*")
    addresses = listening_addresses(port_of(local.web_url()))
    assert addresses
    assert all(ipaddress.ip_address(a).is_loopback for a in addresses)
    everywhere = listening_addresses(port_of(public.web_url()))
    assert any(ipaddress.ip_address(a).is_unspecified for a in everywhere)


def test_the_command_listens_on_the_loopback_unless_told_otherwise() -> None:
    import inspect

    from physim_drake.cli.pick import pick

    assert inspect.signature(pick).parameters["host"].default == "localhost"


@pytest.mark.parametrize("folder", ["physim_drake", "systems", "examples", "docs"])
def test_every_meshcat_is_made_with_a_host(folder: str) -> None:
    made = []
    for path in (ROOT / folder).rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        made += re.findall(r"(?<![\w.])(?:Start)?Meshcat\(.*", text)
        assert not re.search(r"http\.server|socketserver|\.listen\(", text), path
    assert all("host=" in call for call in made), made
