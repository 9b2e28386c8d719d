"""Names to implementations that are found in a package, so that adding one is adding a file."""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from app.errors import OptionError

T = TypeVar("T")


class Registry(Generic[T]):
    """Implementations of one protocol, by name.

    Args:
        kind: what a person calls such a thing, for the error message.
        package: every module in it is imported on first use and registers itself.
    """

    def __init__(self, kind: str, package: str) -> None:
        self.kind, self.package = kind, package
        self._makers: dict[str, Callable[..., T]] = {}
        self._is_loaded = False

    def register(self, name: str, maker: Callable[..., T]) -> None:
        if name in self._makers:
            raise ValueError(f"{self.kind} {name!r} is registered twice")
        self._makers[name] = maker

    def maker(self, name: str) -> Callable[..., T]:
        """The class or function that builds the implementation of that name."""
        self._load()
        try:
            return self._makers[name]
        except KeyError:
            known = ", ".join(sorted(self._makers))
            raise OptionError(
                f"There is no {self.kind} called {name!r}.", f"Choose one of: {known}."
            ) from None

    def make(self, name: str, **options: object) -> T:
        return self.maker(name)(**options)

    def __iter__(self) -> Iterator[str]:
        self._load()
        return iter(sorted(self._makers))

    def _load(self) -> None:
        if self._is_loaded:
            return
        package = importlib.import_module(self.package)
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{self.package}.{module.name}")
        self._is_loaded = True
