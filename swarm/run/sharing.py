"""Processes that share jobs: one job at a time each, whatever comes of it is handed back.

jobs --one each--> workers --as they end--> Done(job, value | problem)

Workers are gone when the generator is closed, also by Ctrl-C; should this process be killed, each
of them notices it by itself (swarm.lifetime).
"""

from __future__ import annotations

import multiprocessing
import time
import traceback
from collections.abc import Callable, Generator, Iterable
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from typing import Generic, TypeVar

import msgspec

from swarm import lifetime
from swarm.run import child

END_S = 2.0  # from SIGTERM to SIGKILL

J = TypeVar("J")
V = TypeVar("V")


class Done(msgspec.Struct, Generic[J, V], frozen=True):
    """One job, and what came of it: a value, or why there is none."""

    job: J
    value: V | None
    problem: str = ""


class _Worker(Generic[J, V]):
    """A process and what it has to do now."""

    def __init__(self, work: Callable[[J], V], name: str) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([work.__module__])
        self.job: J | None = None
        self.end, far = context.Pipe()
        self.process: ForkServerProcess = context.Process(
            target=_main,
            args=(far, work, name, multiprocessing.current_process().pid),
        )
        with child.without_main():
            self.process.start()
        far.close()

    def give(self, job: J) -> None:
        self.job = job
        self.end.send(job)

    def take(self) -> Done[J, V]:
        """What is there to be read, or the worker's end."""
        job, self.job = self.job, None
        assert job is not None
        try:
            value, problem = self.end.recv()
        except (EOFError, ConnectionError):
            self.process.join()
            return Done(job, None, f"its process ended with exit code {self.process.exitcode}")
        return Done(job, value, problem)


def share(
    work: Callable[[J], V], jobs: Iterable[J], workers: int, name: str
) -> Generator[Done[J, V], None, None]:
    """Every job done by some worker, in the order in which they end.

    Args:
        work: a function of a module, so that a process can find it. What it raises is a problem
            of that job alone; a process that dies is replaced.
        jobs: taken one by one, when a worker is free.
        name: of the processes, with a number behind it.
    """
    todo = iter(jobs)
    crew: list[_Worker[J, V]] = []
    try:
        while len(crew) < workers and (first := next(todo, None)) is not None:
            crew.append(_Worker(work, f"{name}-{len(crew) + 1}"))
            crew[-1].give(first)
        while busy := {worker.end: worker for worker in crew if worker.job is not None}:
            for end in connection.wait(list(busy)):
                assert isinstance(end, Connection)
                worker = busy[end]
                yield worker.take()
                job = next(todo, None)
                if job is None:
                    continue
                if worker.process.exitcode is not None:
                    end.close()
                    place = crew.index(worker)
                    worker = crew[place] = _Worker(work, f"{name}-{place + 1}")
                worker.give(job)
    finally:
        _end(crew)


def _end(crew: list[_Worker[J, V]]) -> None:
    try:
        for worker in crew:
            worker.process.terminate()
        deadline_s = time.monotonic() + END_S
        for worker in crew:
            worker.process.join(max(0.0, deadline_s - time.monotonic()))
    finally:
        for worker in crew:
            if worker.process.exitcode is None:
                worker.process.kill()
                worker.process.join()
            worker.end.close()


def _main(end: Connection, work: Callable[[J], V], name: str, parent_pid: int) -> None:
    """Do jobs until there are no more."""
    lifetime.adopt(name, None, lifetime.Stop(), parent_pid)
    while True:
        try:
            job = end.recv()
        except EOFError:
            return
        try:
            answer: tuple[V | None, str] = (work(job), "")
        except Exception as error:  # a crash of one run is a finding, the others go on
            place = traceback.extract_tb(error.__traceback__)[-1]
            text = f"{type(error).__name__}: {error} ({place.name}, line {place.lineno})"
            answer = (None, text)
        try:
            end.send(answer)
        except BrokenPipeError:  # nobody is there any more who would take it
            return
