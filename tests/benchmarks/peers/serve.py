"""Runs in the peers' interpreter: ``python serve.py NAME`` calls ``setup`` of NAME.py with the
options on the first line of its input, and what that returned once for each further line. Each
answer is a line of JSON: {"value": …} or {"error": traceback}; the first has NAME's CONFIGURATION.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from importlib import import_module


def main(name: str) -> None:
    """Serve until the input ends."""
    # what a library prints must not come between the answers
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    call = None
    for line in sys.stdin:
        value = None
        try:
            if call is None:
                peer = import_module(name)
                call, value = peer.setup(**json.loads(line)), peer.CONFIGURATION
            else:
                value = call()
            answer = json.dumps({"value": value})
        except Exception:
            answer = json.dumps({"error": traceback.format_exc()})
        print(answer, file=answers, flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
