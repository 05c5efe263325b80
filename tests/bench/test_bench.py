"""The benchmarks run, say all they should, and judge budgets rightly. No figure has a limit here."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec
import psutil
import pytest

from swarm import errors
from swarm.run import bench
from swarm.run.bench import figures, processes, rehearsal

DEADLINE_S = 20.0

ROWS = {
    "barrier": {
        "bare",
        "whole",
        "whole, recorded",
        "whole less own",
        "whole, growth",
        *(f"of it {part}" for part in PARTS),
    },
}
