"""A peer in its process: values and errors come back, what it prints stays out of the way, and it
ends when it is left.
"""

from __future__ import annotations

import sys
from pathlib import Path

import peer_process
import pytest
from peer_process import PeerError, PeerProcess

PEER = """
import os

CONFIGURATION = "as it likes best"

def setup(scale, fails=False):
    if fails:
        raise ValueError("not with these options")
    calls = []
    def call():
        print("a library's chatter")
        calls.append(len(calls))
        if len(calls) == 3:
            raise ArithmeticError("not a third time")
        if len(calls) == 5:
            os._exit(7)
        return {"calls": calls, "scaled": [2 * value for value in scale]}
    return call
"""


@pytest.fixture(autouse=True)
def here(monkeypatch, tmp_path):
    """This interpreter in place of the peers', and a peer of our own."""
    (tmp_path / "chatterbox.py").write_text(PEER)
    monkeypatch.setattr(peer_process, "INTERPRETER", sys.executable)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


def test_a_peer_is_set_up_once_and_answers_each_call():
    with PeerProcess("chatterbox", {"scale": [1.5]}) as call:
        assert call.configuration == "as it likes best"
        assert call() == {"calls": [0], "scaled": [3.0]}
        assert call() == {"calls": [0, 1], "scaled": [3.0]}


def test_an_error_of_the_peer_comes_with_its_traceback_and_the_peer_lives_on():
    with PeerProcess("chatterbox", {"scale": []}) as call:
        call(), call()
        with pytest.raises(
            PeerError, match=r"chatterbox\.py(?s:.*)ArithmeticError: not a third time"
        ):
            call()
        assert call()["calls"] == [0, 1, 2, 3]


def test_a_peer_that_cannot_be_set_up_or_ends_is_an_error():
    with pytest.raises(PeerError, match="not with these options"):
        PeerProcess("chatterbox", {"scale": [], "fails": True})
    with PeerProcess("chatterbox", {"scale": []}) as call:
        call(), call()
        with pytest.raises(PeerError):
            call()
        call()
        with pytest.raises(PeerError, match="code 7"):
            call()


def test_a_peers_process_ends_when_it_is_left():
    with PeerProcess("chatterbox", {"scale": []}) as call:
        process = Path(f"/proc/{call._process.pid}")
        assert process.exists()
    assert not process.exists()
