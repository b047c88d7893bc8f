"""A server of the page for tests, with a project of its own."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

TOP = Path(__file__).parents[2]
START = 120.0
"""Seconds within which the server must have printed its address, on a machine that other tests keep busy."""


@contextlib.contextmanager
def served(project, *options, stop=signal.SIGINT):
    """Serve a project; yields the process and the address that it printed."""
    with socket.socket() as free:  # tests on several processes would find the same first one
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "softmodels", "app", str(project), "--no-browser", "--port", str(port), *options]
    # NiceGUI serves its own tests by this variable; the program under test is not within one.
    environment = {name: text for name, text in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    process = subprocess.Popen(
        command, cwd=TOP, stdout=subprocess.PIPE, text=True, env={**environment, "PYTHONUNBUFFERED": "1"}
    )
    try:
        line = process.stdout.readline()
        assert line.startswith("softmodels: http://127.0.0.1:"), line
        yield process, line.split()[1]
    finally:
        process.send_signal(stop)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with served(tmp_path_factory.mktemp("bench") / "project") as (_, address):
        yield address


@pytest.fixture
def page(browser, server):
    """A tab that shows the page; an error of its scripts fails the test."""
    with tab(browser, server) as opened:
        yield opened


@contextlib.contextmanager
def tab(browser, address, shown="Device", **options):
    """Open a tab with the key, on one of its pages."""
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **options})
    opened, errors = context.new_page(), []
    opened.set_default_timeout(120_000)
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.goto(address)
    opened.wait_for_function("window.did_handshake")  # before it, the server hears no clicks
    opened.get_by_role("tab", name=shown).click()
    yield opened
    context.close()
    assert not errors


def value(page, name):
    """Return the text of the element with a data-name, once it has one."""
    found = page.locator(f'[data-name="{name}"]')
    for _ in range(600):
        if text := found.text_content():
            return text
        time.sleep(0.1)
    raise AssertionError(f"{name} stays empty")
