"""What a changed simulator or a translator does to the worth of simulated images."""

from __future__ import annotations

from s2rstore.findings.finding import Finding
from s2rstore.intervals import simultaneous_level
from s2rstore.reader import Store

KIND = "exchange rate"


def exchange_rate(store: Store, run: str) -> Finding | None:
    """The change of the run's images with the largest ratio of the exchange rates after and before.

    Of a run whose images are changed itself, that change. It is evident where the intervals before
    and after do not overlap, at a level that holds for all compared runs. None without such runs,
    and where no pair of exchange rates is known.
    """
    from s2rstore.metrics.exchange import changed_runs, exchange_change  # imports SciPy

    names = changed_runs(store, run)
    level = simultaneous_level(max(len(names), 1))
    found = [exchange_change(store, name, level=level) for name in names]
    ratios = [
        (each.after.rate.value / each.before.rate.value, each, each.before)
        for each in found
        if each.before is not None and each.before.rate.is_known and each.after.rate.is_known
    ]
    if not ratios:
        return None
    _, best, before = max(ratios, key=lambda item: item[0])
    return Finding(
        kind=KIND,
        text=f"{best.run}: {best.text}, n {best.after.n}",
        run=best.run,
        n=best.after.n,
        evidence="beside unlimited simulated images" + (
            f"; the largest ratio after / before of {len(names)} changed runs"
            if len(names) > 1 else ""
        ),
        evident=best.is_evident,
        values={
            "exchange_rate": best.after.rate.value, "before": before.rate.value,
            "before_low": before.rate.low, "before_high": before.rate.high,
            "changes": best.changes,
        },
        interval=best.after.rate,
        interval_of="exchange_rate",
        comparisons=len(names),
        n_of="pairs",
        view="exchange",
        other=best.baseline,
    )  # fmt: skip
