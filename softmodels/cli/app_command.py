"""``softmodels app``: the bench on a page."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from softmodels.cli.options import fail
from softmodels.common.commands import status_of
from softmodels.common.errors import reason


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("project", type=click.Path(path_type=Path, file_okay=False), default=Path("project"))
@click.option("--port", type=click.IntRange(1, 65535), help="Port of the page.  [default: a free one from 8700]")
@click.option("--no-browser", is_flag=True, help="Only print the address.")
@click.option(
    "--lan", is_flag=True, help="Let other machines of the network connect with the key, such as a phone's camera."
)
def command(project: Path, port: int | None, no_browser: bool, lan: bool) -> None:
    """Open the bench as a page in the browser: photographs, material, device, mould.

    Everything lies in the folder PROJECT (./project if not given) as plain files, which all other commands read. The page is
    served on this machine only, to those who hold the key in its address; it needs no network.
    """
    try:
        from softmodels.app.server import serve
    except ImportError:
        fail("the page needs NiceGUI; install it by: pip install 'softmodels[app]'")
    try:
        serve(project, port, browser=not no_browser, lan=lan)
    except OSError as error:
        where = f"port {port}" if port and not isinstance(error, FileNotFoundError | PermissionError) else str(project)
        fail(f"{where} cannot be used ({reason(error)}); give another one", status_of(error))
    sys.exit(0)
