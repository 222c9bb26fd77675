"""What a worker does, wherever it runs: a few trials in a row, each on arguments of its own."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable

Block = list[bytes]  # of trials, each pickled
Results = tuple[float, list[bytes]]  # s that the block took, and the results, each pickled
# hands a block to a worker; what it returns waits for the results, or raises their error
Submit = Callable[[Block], Callable[[], Results]]


def run_block(function: bytes, block: Block) -> Results:
    """The results of the pickled ``function`` at each trial of ``block``, and how long they took.

    Unpickled arrays are laid out anew, and the last bit of a sum follows the layout: so the
    function, every trial and every result go through pickle even where they stay in one process,
    and no trial sees what another has done to the arguments that they share.
    """
    begin = time.perf_counter()
    results = [pickle.dumps(pickle.loads(function)(pickle.loads(trial))) for trial in block]
    return time.perf_counter() - begin, results
