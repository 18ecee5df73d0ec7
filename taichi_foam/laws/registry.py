"""What a scene may choose from, by the word that it writes: bond laws, impactor shapes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Generic, TypeVar

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from taichi_foam.parts import Part

Kind = TypeVar("Kind", bound=Part)


class Registry(Mapping[str, type[Kind]], Generic[Kind]):
    """Classes of one kind, by their tag.

    tag       field that tells them apart, a Literal in each class
    meaning   what that field says
    default   tag of what a table without one is; None: a table must have one
    watchers  called when a class is registered
    """

    def __init__(self, tag: str, meaning: str, default: str | None = None) -> None:
        self.tag, self.meaning, self.default = tag, meaning, default
        self.watchers: list[Callable[[], object]] = []
        self._kinds: dict[str, type[Kind]] = {}

    def register(self, kind: type[Kind]) -> type[Kind]:
        """Add a class, or replace the one of its tag; returns it, for use as a decorator."""
        self._kinds[kind.model_fields[self.tag].default] = kind
        for watcher in self.watchers:
            watcher()
        return kind

    def remove(self, tag: str) -> None:
        """Take a class out again."""
        del self._kinds[tag]
        for watcher in self.watchers:
            watcher()

    __hash__ = object.__hash__  # there is one of each kind

    def __getitem__(self, tag: str) -> type[Kind]:
        return self._kinds[tag]

    def __iter__(self) -> Iterator[str]:
        return iter(self._kinds)

    def __len__(self) -> int:
        return len(self._kinds)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """As metadata of a field: a union of all classes, told apart by their tag."""
        return core_schema.tagged_union_schema(
            {tag: handler.generate_schema(kind) for tag, kind in self._kinds.items()},
            discriminator=self.tag_of,
        )

    @staticmethod
    def _implies(kind: type[Part], value: Mapping[str, Any]) -> bool:
        """Whether a table has the key that only this class has."""
        return getattr(kind, "implied_by", None) in value

    def kind_of(self, value: Any) -> type[Kind] | None:
        """The class of a table, or of an instance; None if it has none."""
        tag = self.tag_of(value)
        return self.get(tag) if isinstance(tag, str) else None

    def tag_of(self, value: Any) -> Any:
        """The tag of a table, or of an instance; a table without one has that of its keys."""
        if not isinstance(value, Mapping):
            return getattr(value, self.tag, None)
        tag = value.get(self.tag)
        if tag is None:
            implied = (name for name, kind in self._kinds.items() if self._implies(kind, value))
            tag = next(implied, self.default)
        return tag if tag is None or isinstance(tag, str) else ""  # which no class has
