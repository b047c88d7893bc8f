"""Notebooks as pages of the site, with the outputs that are stored in them.

``uv run --group docs --group dev python docs/notebook_pages.py`` executes all notebooks in ``docs/pages/notebooks``
and stores their outputs again.
"""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.structure.files import File

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

FOLDER = Path(__file__).parent / "pages" / "notebooks"
PICTURES = ("image/jpeg", "image/png")
"""Kinds of pictures, the smaller first."""


class Notebook(File):
    """A notebook that is a page, and not a file to be copied."""

    def is_documentation_page(self) -> bool:
        return True


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """MkDocs calls this with the list of pages: make the notebooks pages."""
    for file in [file for file in files if file.src_uri.endswith(".ipynb")]:
        files.remove(file)
        files.append(Notebook(file.src_uri, file.src_dir, file.dest_dir, file.use_directory_urls))
    return files


def on_page_read_source(page: Page, config: MkDocsConfig) -> str | None:
    """MkDocs calls this for the text of a page; None for those that are Markdown already."""
    return markdown(Path(page.file.abs_src_path)) if isinstance(page.file, Notebook) else None


def markdown(path: Path) -> str:
    """Return a notebook as Markdown."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts += [text] if cell["cell_type"] == "markdown" else [f"```python\n{text}\n```", *map(output, cell["outputs"])]
    return "\n\n".join(parts) + "\n"


def output(told: dict) -> str:
    """Return a cell's output as HTML in Markdown, which ends at a blank line."""
    data = told.get("data", {"text/plain": told.get("text", "")})
    kind = next(kind for kind in ("text/html", *PICTURES, "text/plain") if kind in data)
    text = "".join(data[kind]).replace('<table border="1" class="dataframe">', "<table>")  # as the site's own tables
    if kind == "text/plain":
        return f"<pre>{html.escape(text)}</pre>"
    if kind in PICTURES:
        text = f'<img alt="output of the cell above" src="data:{kind};base64,{"".join(text.split())}">'
    return "<div>" + "".join(line.strip() + "\n" for line in text.splitlines() if line.strip()) + "</div>"


def refresh(path: Path) -> None:
    """Execute a notebook in an empty folder, and store its outputs: of each the richest kind only."""
    import tempfile

    import nbclient
    import nbformat

    book = nbformat.read(path, 4)
    with tempfile.TemporaryDirectory() as folder:
        nbclient.NotebookClient(book, timeout=600, record_timing=False, resources={"metadata": {"path": folder}}).execute()
    for told in (told for cell in book.cells if cell.cell_type == "code" for told in cell.outputs if "data" in told):
        best = next(kind for kind in ("text/html", *PICTURES, "text/plain") if kind in told.data)
        told.data = {kind: told.data[kind] for kind in {best, "text/plain"}}
    book.metadata.language_info = {"name": "python"}
    nbformat.write(book, path)


if __name__ == "__main__":
    for notebook in sorted(FOLDER.glob("*.ipynb")):
        print(notebook)
        refresh(notebook)
