"""What every page that is written has in common: it fits a phone's width, and paper.

A table that is wider than the screen scrolls by itself, inside ``<div class="wide">``; pictures shrink.
"""

from __future__ import annotations

VIEWPORT = '<meta name="viewport" content="width=device-width, initial-scale=1">'
"""Without it a phone shows a page as a desktop's, small."""

RULES = """*{box-sizing:border-box}body{overflow-wrap:break-word}img{max-width:100%;height:auto}
.wide{max-width:100%;overflow-x:auto}td.n{white-space:nowrap}
@media (max-width:640px){th,td{padding:.15em .4em!important}}
@media print{@page{margin:14mm}.wide{overflow:visible}figure,img,tr{break-inside:avoid}
h1,h2,h3{break-after:avoid}table{font-size:8.5pt}img{max-height:230mm}}
"""
"""Style for the end of a page's own."""


def wide(table: str) -> str:
    """A table that scrolls by itself where the screen is narrower."""
    return f'<div class="wide">{table}</div>'
