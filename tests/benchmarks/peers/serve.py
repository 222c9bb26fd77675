"""Runs in the peers' interpreter: ``python serve.py NAME`` calls ``setup`` of NAME.py with the
options on the first line of its input and answers with its CONFIGURATION; for each further line it
calls what that returned and answers with the result. An answer is a line of JSON.
"""

import json
import os
import sys
from importlib import import_module

# what a library prints must not come between the answers
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)
peer = import_module(sys.argv[1])
call = peer.setup(**json.loads(sys.stdin.readline()))
print(json.dumps(peer.CONFIGURATION), file=answers, flush=True)
for _ in sys.stdin:
    print(json.dumps(call()), file=answers, flush=True)
