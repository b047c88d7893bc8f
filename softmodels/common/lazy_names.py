"""Public names of a package that are loaded when they are first used.

Every package here begins with this, so it imports the standard library alone: Ctrl-C while the rest is imported ends with a
sentence, see `softmodels.common.commands.stoppable`.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence

from softmodels.common.errors import meant


def lazy_names(
    package: str, places: Mapping[str, Sequence[str]]
) -> tuple[list[str], Callable[[str], object], Callable[[], list[str]]]:
    """Return a package's ``__all__``, ``__getattr__`` and ``__dir__`` (PEP 562).

    Args:
        package: The package's ``__name__``.
        places: Public names by the module that defines them.
    """
    module_of = {name: module for module, names in places.items() for name in names}
    namespace = vars(sys.modules[package])

    def load(name: str) -> object:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}{meant(name, module_of)}")
        namespace[name] = value = getattr(importlib.import_module(module_of[name]), name)
        return value

    return [*module_of], load, lambda: sorted({*namespace, *module_of})
