"""A clock for waiting on locks in tests: a pause takes no time and advances the clock."""

from collections.abc import Callable
from dataclasses import dataclass

from s2rstore.files.lease import Timing


@dataclass
class LockClock:
    """Seconds that were waited; `during_pause` is called after each pause."""

    now: float = 0.0
    pauses: int = 0
    during_pause: Callable[[], object] = lambda: None

    def pause(self, seconds: float) -> None:
        self.now += seconds
        self.pauses += 1
        self.during_pause()

    @property
    def timing(self) -> Timing:
        return Timing(clock=lambda: self.now, pause=self.pause)
