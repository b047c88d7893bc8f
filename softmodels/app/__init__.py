"""The bench on a page: `softmodels app` opens it in the browser, on this machine.

Begin with `server`, which serves the page to who holds its key, and builds the frame around all pages.

- `bench`: what all tabs share, the project's folder of plain files first, which the command line and Python read too.
  `history`: its inputs before the last changes. `packing`: the folder as one file, to send.
- `jobs`: commands in processes of their own, which survive a closed tab and are resumed after a killed server; processes
  that keep the solver loaded, for answers while sliders move.
- `answers`, `tracing`: what these processes answer, of devices and of photographs. `replies`: what both sides import.
- `forms`: what pages are made of. `kept`: lists of what is kept under names.
- `start`, `photographs`, `device`, `making`: the pages.
"""
