"""What a configuration asks of the simulator's identification."""

from __future__ import annotations

from typing import TYPE_CHECKING

from s2rstore.errors import RequestError

if TYPE_CHECKING:
    from s2rtools.nightly.config import Sysid
    from s2rtools.sysid import SysidSettings


def settings(wanted: Sysid) -> SysidSettings:
    """As `s2r sysid` would have them. Raises RequestError for ranges that are none."""
    from s2rtools.sysid import SysidSettings
    from s2rtools.sysid.parameter_space import parsed

    ranges = {}
    for name, text in wanted.ranges.items():
        try:
            ranges[name] = parsed(text)
        except RequestError as error:
            raise RequestError(f"range.{name}: {error}") from None
    return SysidSettings(
        wanted.simulator, wanted.parameters, wanted.fixed, wanted.seeds, seed=wanted.seed,
        evaluations=wanted.evaluations, ranges=ranges,
    )  # fmt: skip


def check(wanted: Sysid) -> None:
    """Raises RequestError for simulators, parameters, values and ranges that there are not."""
    from s2rtools.sysid.identify import wanted_simulator

    wanted_simulator(settings(wanted))
