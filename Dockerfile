# softmodels with everything it needs: docker build -t softmodels . && docker run --rm -v "$PWD/results:/softmodels/results" softmodels
FROM debian:trixie-slim

# A C compiler for the equations (compiled at run time), the X and GL libraries that Gmsh and VTK link against even where
# nothing is shown, GLib for lensfun. The rest comes from PyPI.
RUN apt-get update \
 && apt-get install --no-install-recommends -y ca-certificates gcc libc6-dev python3 python3-dev python3-venv \
    libegl1 libfontconfig1 libgl1 libglib2.0-0t64 libglu1-mesa libxcursor1 libxfixes3 libxft2 libxinerama1 libxrender1 \
 && rm -rf /var/lib/apt/lists/*

# uv in an environment of its own, since Debian keeps pip away from its Python.
RUN python3 -m venv /opt/uv && /opt/uv/bin/pip install --no-cache-dir uv
ENV PATH=/opt/uv/bin:$PATH UV_LINK_MODE=copy OMP_NUM_THREADS=1

WORKDIR /softmodels
COPY pyproject.toml .python-version README.md LICENSE ./
COPY geometries geometries
COPY measurement measurement
COPY softmodels softmodels
COPY docs docs
COPY tests tests
# The page and studies are there too. Bytecode is written once here: a container starts with it, also where nothing may be written.
RUN uv sync --extra app --extra study --compile-bytecode \
 && uv run python -m compileall -q softmodels geometries measurement tests \
 && uv run softmodels doctor

CMD ["uv", "run", "python", "-m", "softmodels.disk", "--pressure-cm", "0:177"]
