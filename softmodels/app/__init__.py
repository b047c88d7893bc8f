"""The bench on a page: `softmodels app` opens it in the browser, on this machine.

Begin with `server`, which serves the page to who holds its key; `shell` is the frame around all pages.

- `bench`: what all tabs share. `project`: its folder of plain files, which the command line and Python read too.
- `jobs`: commands in processes of their own, which survive a closed tab and are resumed after a killed server.
- `warm`: a process that keeps the solver loaded, for answers while sliders move. `drawing`: sections as SVG.
- `answers`, `tracing`: what these processes answer, of devices and of photographs.
- `forms`: controls for the fields of a device.
- `photographs`, `material`, `device`, `making`, `overlay`: the pages.
"""
