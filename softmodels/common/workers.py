"""Processes that answer calls: kept loaded, so that one question costs only its own time, and replaced when they die."""

from __future__ import annotations

import contextlib
import importlib
import os
import pickle
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from multiprocessing.connection import Connection
from typing import Any

from softmodels.common.errors import reason
from softmodels.common.processes import end_with_parent, environment_alone

ENDED = "the process that computes ended, perhaps because memory ran out; use larger cells, and try again"


type Answer = tuple[bool, Any]
"""Whether a function returned, and its value; else the sentence of its error."""


class DiedError(Exception):
    """The process ended before it answered."""


class Worker:
    """A process that calls functions of one module, which this one need not import, one call at a time; started at the first
    call, and after it died. It is a program of its own, no copy of this one: neither scripts without a guard nor notebooks are
    run again."""

    def __init__(self, module: str):
        self.module = module
        self._process: subprocess.Popen[bytes] | None = None
        self._line: Connection

    def start(self) -> None:
        """Start the process, which imports its module now and not at the first call."""
        if self._process is not None and self._process.poll() is None:
            return
        self.stop()
        here, there = socket.socketpair()
        words = [sys.executable, "-m", __name__, self.module, str(there.fileno())]
        path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)  # noqa: PTH109  (as the modules here are found)
        self._process = subprocess.Popen(
            words, pass_fds=[there.fileno()], env={**environment_alone(), "PYTHONPATH": path}, stdin=subprocess.DEVNULL
        )
        there.close()
        self._line = Connection(here.detach())

    def call(self, function: str, *args: object) -> Answer:
        """Return the answer of a function of the module; `DiedError` if the process ended meanwhile."""
        try:
            order = pickle.dumps((function, args))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            return False, f"this cannot be sent to another process ({reason(error)}); define its classes in a module"
        try:
            self.start()
            self._line.send_bytes(order)
            found: Answer = self._line.recv()
        except (EOFError, OSError):
            self.stop()
            raise DiedError(ENDED) from None
        return found

    def answer(self, function: str, task: object, closed: Callable[[], bool] = bool) -> Answer:
        """Return the answer to a task, which is given to a new process once more if the first one dies before all is closed."""
        try:
            with contextlib.suppress(DiedError):
                return self.call(function, task)
            return (False, ENDED) if closed() else self.call(function, task)
        except DiedError as error:
            return False, str(error)

    def stop(self) -> None:
        """End the process."""
        if self._process is None:
            return
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._line.close()
        self._process = None


def answers(module: str, function: str, tasks: Mapping[int, object], count: int) -> Iterator[tuple[int, Answer]]:
    """Yield the number of each task and its `Worker.answer`, as soon as it is known; several processes share the tasks."""
    workers = [Worker(module) for _ in range(min(count, len(tasks)))]
    free: queue.SimpleQueue[Worker] = queue.SimpleQueue()
    for worker in workers:
        worker.start()  # by this thread: a process ends with the thread that started it
        free.put(worker)

    closed = threading.Event()

    def answer(task: object) -> Answer:
        worker = free.get()
        try:
            return worker.answer(function, task, closed.is_set)
        finally:
            free.put(worker)

    with ThreadPoolExecutor(max(len(workers), 1)) as pool:
        try:
            numbers = {pool.submit(answer, task): number for number, task in tasks.items()}
            for future in as_completed(numbers):
                yield numbers[future], future.result()
        finally:
            closed.set()
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.stop()


def serve(module: str, line: Connection) -> None:
    """Answer calls until the line is closed; in the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    end_with_parent()
    functions = importlib.import_module(module)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            order = line.recv_bytes()
            try:
                function, args = pickle.loads(order)
                line.send((True, getattr(functions, function)(*args)))
            except Exception as error:
                line.send((False, reason(error)))


if __name__ == "__main__":
    serve(sys.argv[1], Connection(int(sys.argv[2])))
