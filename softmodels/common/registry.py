"""Classes by name, to which a user's own are added: laws, devices, components, supplies, quantities of designs, checks.

Each registry has a class decorator, such as ``register_law = LAWS.register``. A class of the same module and name, as a
notebook defines it anew, takes the place of the one before.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from types import MappingProxyType

from softmodels.common.calls import checked


class Registry[T](MutableMapping[str, type[T]]):
    """Classes of one kind by name.

    Args:
        what: What they are, in a word, for messages.
        name: A class's name in the registry.
        places: Modules of the library's own by name; a module is imported, and registers its class, when it is looked up.
        made_known: Called with each class that is registered.
    """

    def __init__(
        self,
        what: str,
        name: Callable[[type[T]], str],
        places: Mapping[str, str] = MappingProxyType({}),
        made_known: Callable[[type[T]], None] = lambda cls: None,
    ) -> None:
        self._what, self._name, self._places, self._made_known = what, name, places, made_known
        self.loaded: dict[str, type[T]] = {}

    def register[C](self, cls: type[C]) -> type[C]:
        """Let case files and command lines find a class by its name; a class decorator.

        Raises:
            ValueError: Another class has this name.
        """
        name = self._name(cls)  # type: ignore[arg-type]
        place = (self._places.get(name, cls.__module__), name if name in self._places else cls.__qualname__)
        if known := self.loaded.get(name):
            place = (known.__module__, known.__qualname__)
        if place != (cls.__module__, cls.__qualname__):
            raise ValueError(f"there is a {self._what} of the name {name!r} already, in {place[0]}")
        self.loaded[name] = checked(cls)  # type: ignore[assignment]
        self._made_known(cls)  # type: ignore[arg-type]
        return cls

    def __getitem__(self, name: str) -> type[T]:
        if name not in self.loaded and name in self._places:
            importlib.import_module(self._places[name])
        return self.loaded[name]

    def __setitem__(self, name: str, cls: type[T]) -> None:
        self.loaded[name] = cls

    def __delitem__(self, name: str) -> None:
        del self.loaded[name]

    def __iter__(self) -> Iterator[str]:
        yield from self._places
        yield from (name for name in list(self.loaded) if name not in self._places)

    def __contains__(self, name: object) -> bool:
        return name in self._places or name in self.loaded

    def __len__(self) -> int:
        return len(self._places.keys() | self.loaded.keys())
