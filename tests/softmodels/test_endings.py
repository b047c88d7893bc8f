"""Stopped in the first second, output that has nowhere to go: one sentence and a status, in every program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from unittest import mock

import click
import pytest

from softmodels.common.commands import run_command

STARTS = {
    "softmodels.disk": ["--pressure-cm", "0:100"],
    "softmodels.seminar": ["--pressure-cm", "0:100"],
    "softmodels": ["limit", "--variant", "shadow"],
    "measurement": ["demo"],
    "geometries": ["HollowDisk", "--cell-size", "0.3mm"],
}


def started(module, words, folder, **streams):
    return subprocess.Popen(
        [sys.executable, "-m", module, *words], cwd=folder, stderr=subprocess.PIPE, text=True, **streams
    )


@pytest.mark.parametrize("module", STARTS)
def test_stopped_while_it_is_imported(module, tmp_path):
    """Stopped as soon as the numbers' library is looked for, which every program imports and which takes longest."""
    with started(module, STARTS[module], tmp_path, stdout=subprocess.DEVNULL) as process:
        for _ in range(1000):
            with open(f"/proc/{process.pid}/maps") as maps:  # noqa: PTH123
                if "numpy" in maps.read():
                    break
            time.sleep(0.005)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.count("\n") == 1 and "stopped by the user" in err, err


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("softmodels.disk", ["--help"]),
        ("softmodels", ["doctor", "--help"]),
        ("measurement", ["--help"]),
        ("geometries", []),
    ],
)
def test_output_that_has_nowhere_to_go(module, words, tmp_path):
    with open("/dev/full", "w") as full, started(module, words, tmp_path, stdout=full) as process:  # noqa: PTH123
        _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err.count("\n") == 1 and "No space left on device" in err, err
    reader, writer = os.pipe()
    os.close(reader)
    with started(module, words, tmp_path, stdout=writer) as process:
        os.close(writer)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (1, "")


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("softmodels", [" " * 3000 + "x"]),
        ("softmodels.disk", ["--pressure-cm", "0:1", "--control", "x" * 3000]),
        ("measurement", [" " * 3000 + "x"]),
        ("geometries", ["HollowDisk", "--variant", "x" * 3000]),
    ],
)
def test_words_without_end_get_a_sentence_with_one(module, words, tmp_path):
    """What a user pastes by mistake, such as a whole file, is not repeated in full."""
    with started(module, words, tmp_path, stdout=subprocess.DEVNULL) as process:
        _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert len(err) < 1500 and " ... " in err and "x'" in err, err


def test_full_memory_is_a_sentence(capsys):
    @click.command()
    def greedy():
        raise MemoryError

    with mock.patch.object(sys, "argv", ["greedy"]), pytest.raises(SystemExit) as end:
        run_command(greedy, "greedy")
    assert end.value.code == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "out of memory" in err
