"""What the forkserver loads last: keeps the pages it shares with every robot shared.

A collection in a child writes to the header of every object it visits, and so copies the pages
that hold them; what is frozen is not visited (14.1 -> 7.4 MB of its own per robot at N = 50).

The navigator's inner loops are loaded here, once for all robots, and compiled when that was never
done before on this machine.
"""

import gc
import sys
import threading

from agents.navigator import compiled, warm

SLOW_S = 1.0

_notice = threading.Timer(
    SLOW_S,
    print,
    ["swarm: compiling the navigator's inner loops, once on this machine (about 20 s)"],
    {"file": sys.stderr, "flush": True},
)
if not compiled.is_kept():
    _notice.start()
try:
    warm.up()
finally:
    if _notice.is_alive():
        _notice.cancel()
        _notice.join()  # no thread may be there when robots are forked

gc.collect()
gc.freeze()
