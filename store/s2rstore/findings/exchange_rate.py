"""What a changed simulator or a translator does to the worth of simulated images."""

from __future__ import annotations

from s2rstore.findings.finding import Finding
from s2rstore.intervals import simultaneous_level
from s2rstore.reader import Store

KIND = "exchange rate"


def exchange_rate(store: Store, run: str) -> Finding | None:
    """The change of the images of the run that raises its exchange rate most.

    Of a run whose images are changed itself, that change. It is evident where the intervals before
    and after do not overlap, at a level that holds for all compared runs. None without such runs,
    and where no exchange rate is known.
    """
    from s2rstore.metrics.exchange import changed_runs, exchange_change  # imports SciPy

    names = changed_runs(store, run)
    level = simultaneous_level(max(len(names), 1))
    found = [exchange_change(store, name, level=level) for name in names]
    known = [each for each in found if each.after.rate.is_known]
    if not known:
        return None
    best = max(known, key=lambda each: each.after.rate.value)
    assert best.before is not None
    return Finding(
        kind=KIND,
        text=f"{best.run}: {best.text}, n {best.after.n}",
        run=best.run,
        n=best.after.n,
        evidence=f"beside unlimited simulated images; the highest of {len(names)} changed runs"
        if len(names) > 1 else "beside unlimited simulated images",
        evident=best.is_evident,
        values={
            "exchange_rate": best.after.rate.value, "before": best.before.rate.value,
            "before_low": best.before.rate.low, "before_high": best.before.rate.high,
            "changes": best.changes,
        },
        interval=best.after.rate,
        interval_of="exchange_rate",
        comparisons=len(names),
        n_of="pairs",
        view="exchange",
        other=best.baseline,
    )  # fmt: skip
