"""What users add to by name: laws, devices, components, supplies, quantities of designs, outputs of runs, checks.

Entries are classes, and objects of `softmodels.runs.fields.Output`. Each registry has a function that registers, such as
``register_law = LAWS.register``; for classes it is a decorator. An entry of the same module and name, as a notebook defines
it anew, takes the place of the one before.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from types import MappingProxyType

from softmodels.common.calls import checked


class Registry[T](MutableMapping[str, T]):
    """Entries of one kind by name.

    Args:
        what: What they are, in a word, for messages.
        name: An entry's name in the registry.
        places: Modules of the library's own by name; a module is imported, and registers its class, when it is looked up.
        made_known: Called with each entry that is registered.
    """

    def __init__(
        self,
        what: str,
        name: Callable[[T], str],
        places: Mapping[str, str] = MappingProxyType({}),
        made_known: Callable[[T], None] = lambda entry: None,
    ) -> None:
        self._what, self._name, self._places, self._made_known = what, name, places, made_known
        self.loaded: dict[str, T] = {}

    def register[C](self, entry: C) -> C:
        """Let case files, command lines and runs find an entry by its name; a decorator of a class.

        Raises:
            ValueError: Another one has this name.
        """
        name = self._name(entry)  # type: ignore[arg-type]
        place = _place(entry, name)
        known = _place(self.loaded[name], name) if name in self.loaded else (self._places.get(name, place[0]), place[1])
        if place != known:
            raise ValueError(f"the name {name!r} is taken by another {self._what}, in {known[0]}")
        self.loaded[name] = checked(entry) if isinstance(entry, type) else entry  # type: ignore[assignment]
        self._made_known(entry)  # type: ignore[arg-type]
        return entry

    def __getitem__(self, name: str) -> T:
        if name not in self.loaded and name in self._places:
            importlib.import_module(self._places[name])
        return self.loaded[name]

    def __setitem__(self, name: str, entry: T) -> None:
        self.loaded[name] = entry

    def __delitem__(self, name: str) -> None:
        del self.loaded[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._places
        yield from (name for name in list(self.loaded) if name not in self._places)

    def __contains__(self, name: object) -> bool:
        return name in self._places or name in self.loaded

    def __len__(self) -> int:
        return len(self._places.keys() | self.loaded.keys())


def _place(entry: object, name: str) -> tuple[str, str]:
    """Return the module of an entry, and the name that it has there."""
    return entry.__module__, getattr(entry, "__qualname__", name)
