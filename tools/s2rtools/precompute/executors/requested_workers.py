"""The workers that were requested for a cluster, and those of them that will not come."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class RequestedWorkers:
    """`count` workers, each by a job or process of its own.

    `refused` are the errors of jobs that could not be submitted, by the names of their workers.
    Another thread may change them meanwhile.
    """

    count: int
    refused: dict[str, str] = field(default_factory=dict)
    _told: int = 0

    @property
    def arriving(self) -> int:
        """How many workers run or are on their way."""
        return self.count - len(self.refused)

    @property
    def refusal(self) -> str:
        """How many jobs were refused, with the last error; empty where none were."""
        errors = [*self.refused.values()]
        return f"{len(errors)} of {self.count} jobs were refused ({errors[-1]})" if errors else ""

    def news(self) -> str:
        """The refusal, where more jobs are refused than at the last call, else nothing."""
        before, self._told = self._told, len(self.refused)
        return self.refusal if self._told > before else ""
