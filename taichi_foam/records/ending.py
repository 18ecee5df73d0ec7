"""How a run ended."""

from __future__ import annotations

from enum import Enum


class Ending(str, Enum):
    """How a run ended. Its value is the word in summary.json (`run.ended_by`), and compares equal.

    meaning  the ending in words
    remedy   what to do about a failure; empty for other endings
    """

    meaning: str
    remedy: str

    END_TIME = "end time", "it reached numerics.end or numerics.time_limit"
    REBOUND = "rebound", "the impactor came to rest and rebounded"
    DIVERGED = (
        "diverged",
        "values are not finite, or far beyond what foam can reach",
        "set numerics.dt = 'auto'; if it is that already, divide numerics.safety by four",
    )
    CROWDED = (
        "too many neighbours",
        "more pieces touch in one place than the list of neighbours can hold",
        "set model.self_contact = false, or use a finer lattice",
    )
    INTERRUPTED = "interrupted", "it was stopped before its end"

    def __new__(cls, word: str, meaning: str, remedy: str = "") -> Ending:
        member = str.__new__(cls, word)
        member._value_ = word
        member.meaning = meaning
        member.remedy = remedy
        return member

    def __str__(self) -> str:
        return self.value

    @property
    def failed(self) -> bool:
        """Whether the run failed: its last values are then of no use."""
        return bool(self.remedy)
