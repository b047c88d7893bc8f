"""Commands of a page of documentation."""

from __future__ import annotations

import re


def commands(body):
    """Commands of the text of a block of commands, in order: lines that are continued are one, comments are left out."""
    lines = re.sub(r" \\\n +", " ", body).splitlines()
    return [line.split("  #")[0].rstrip() for line in lines if line.strip() and not line.startswith("#")]


def pasted(page):
    """Commands of all blocks of commands of a page, a file, in order."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
    return [line for block in blocks for line in commands(block)]
