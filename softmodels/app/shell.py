"""The frame around all pages: their names, the project, light and dark, what is going on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softmodels.app.device import DevicePage
from softmodels.app.making import DesignPage, MouldPage
from softmodels.app.material import MaterialPage
from softmodels.app.overlay import OverlayPage
from softmodels.app.photographs import PhotographsPage

if TYPE_CHECKING:
    from softmodels.app.bench import Bench

STYLE = """
svg.section { width: 100%; max-height: 62vh; }
svg.section .rest { stroke: #8a8a8a; stroke-dasharray: 0.6 0.4; }
svg.section .edge { stroke: currentColor; }
svg.section .scale-bar path { stroke: currentColor; fill: none; }
svg.section .scale-bar text { fill: currentColor; }
.two-columns { display: grid; grid-template-columns: minmax(0, 1fr); gap: 1rem; width: 100%; }
@media (min-width: 900px) { .two-columns { grid-template-columns: 22rem minmax(0, 1fr); } }
.q-header { flex-wrap: nowrap; }
.q-header .q-tabs { min-width: 0; }
@media (max-width: 700px) {
  .brand { position: absolute; clip-path: inset(50%); }
  .q-header .q-tab__label { display: none; }
  .q-header .q-tab { min-width: 0; padding: 0 8px; }
}
.colour-bar { display: flex; gap: 0.6rem; align-items: center; font-size: 0.85rem; max-width: 30rem; margin: 0 auto; }
.colour-bar div { flex: 1; height: 0.7rem; }
.brand { font-size: 1rem; line-height: 1.5rem; font-weight: 700; margin: 0; }
.q-tab--inactive { opacity: 1; }
.quiet { color: #616161; }
.body--dark .quiet { color: #bdbdbd; }
.body--dark .nicegui-content { --q-negative: #ff8a80; }
.body--dark :is(.q-btn--flat, .q-btn--outline, .q-field, .q-slider, .q-toggle) { --q-primary: #8ec5f4; }
.body--dark a { color: #8ec5f4; }
.photograph svg polyline { fill: none; stroke-width: 2.5; vector-effect: non-scaling-stroke; }
.photograph svg .traced { stroke: #e6194b; }
.photograph svg .band { fill: #e6194b; fill-opacity: 0.3; stroke: none; }
.cures { outline: 2px solid #f58231; outline-offset: 3px; border-radius: 4px; }
.photograph svg .simulated { stroke: #f5d90a; }
.photograph svg .zero { stroke: #0082c8; stroke-dasharray: 8 5; }
.photograph svg circle { fill: none; stroke: #3cb44b; stroke-width: 2; }
.photograph svg .handle { fill: #0082c8aa; stroke: white; }
.photograph svg .roi { fill: none; stroke: #f58231; stroke-width: 2.5; }
.photograph svg .mask { fill: #f5823166; stroke: #f58231; stroke-width: 1.5; }
.photograph img { touch-action: none; }
img.stored { max-height: 60vh; max-width: 100%; margin: 0 auto; display: block; border-radius: 4px; }
iframe { width: 100%; height: 80vh; border: 0; background: white; }
.nicegui-content { padding: 0.75rem; }
"""


ICON = "🎈"
BLUE = "#1f5f99"
"""Of buttons and the head of the page: white on it has a contrast of 6.6."""
HEAD = """<script>
document.documentElement.lang = "en";
new MutationObserver(() => document.querySelectorAll("img:not([alt])").forEach(img =>
  img.alt = img.closest("[aria-label]")?.getAttribute("aria-label") ?? ""
)).observe(document, {childList: true, subtree: true});
</script>"""
"""The page's language, and words for pictures that NiceGUI leaves without."""


def build_page(bench: Bench) -> None:
    """Build the page of one tab."""
    from nicegui import ui

    pages = {
        "Photographs": ("photo_camera", PhotographsPage),
        "Material": ("science", MaterialPage),
        "Device": ("tune", DevicePage),
        "Overlay": ("layers", OverlayPage),
        "Design": ("auto_fix_high", DesignPage),
        "Mould": ("view_in_ar", MouldPage),
    }
    ui.add_css(STYLE)
    ui.add_head_html(HEAD)
    ui.colors(primary=BLUE)
    with ui.header(elevated=False).classes("items-center gap-2 py-1"):
        ui.html('<h1 class="brand">softmodels</h1>', sanitize=False)
        with ui.tabs().props("dense mobile-arrows inline-label").classes("grow") as tabs:
            for name, (icon, _) in pages.items():
                ui.tab(name, icon=icon).props(f'aria-label="{name}"')
        if bench.address:
            import segno

            with ui.button(icon="qr_code").props('flat round dense color=white aria-label="phone"'), ui.menu():
                ui.html(segno.make(bench.address).svg_inline(scale=5, light="white"), sanitize=False)
        dark = ui.dark_mode(None)
        ui.button(icon="dark_mode", on_click=lambda: dark.set_value(not dark.value)).props(
            'flat round dense color=white aria-label="light or dark"'
        )
    with ui.tab_panels(tabs, value="Device").classes("w-full bg-transparent"):
        for name, (_, page) in pages.items():
            with ui.tab_panel(name).classes("p-0"):
                page(bench)
