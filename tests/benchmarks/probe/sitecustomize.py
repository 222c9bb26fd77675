"""Imported by every Python that has this folder in PYTHONPATH: a stage of the pipeline leaves what
it cost when it ends.

It is a line of JSON at the end of the file COST_OF_STAGES.
"""

import atexit
import json
import os
import resource
import sys
import time

BEGIN = time.perf_counter()


def write_cost() -> None:
    """Processor time in s and peak memory in bytes of this process and of those that it waited for,
    and elapsed time in s.
    """
    if (module := sys.modules.get("multiprocessing.forkserver")) and (
        server := module._forkserver
    )._forkserver_pid:
        # workers are children of a server, which ends with this pipe, and which nobody else waits
        # for
        os.close(server._forkserver_alive_fd)
        os.waitpid(server._forkserver_pid, 0)
    own, others = (
        resource.getrusage(resource.RUSAGE_SELF),
        resource.getrusage(resource.RUSAGE_CHILDREN),
    )
    cost = {
        "stage": " ".join(sys.orig_argv[3:]),
        "cpu": sum(usage.ru_utime + usage.ru_stime for usage in (own, others)),
        "memory": 1024 * max(own.ru_maxrss, others.ru_maxrss),
        "elapsed": time.perf_counter() - BEGIN,
    }
    with open(os.environ["COST_OF_STAGES"], "a") as file:
        file.write(json.dumps(cost) + "\n")


# workers and DVC have other command lines
if sys.orig_argv[1:3] == ["-m", "pipeline"]:
    atexit.register(write_cost)
