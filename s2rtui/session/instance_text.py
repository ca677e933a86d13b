"""One instance in one line: where it is, and how large its errors are."""

from __future__ import annotations

import math

from s2rstore.reader import Store
from s2rstore.records import NO_RUN, SIDES
from s2rtui.session.pending_target import run_is_loaded
from s2rtui.session.state import State


def instance_text(store: Store, state: State, iid: int) -> str:
    """`#41 kitchen, sim 0.12 m, real 3.45 m, gap +3.33 m`; errors as far as they are loaded."""
    truth = store.instances
    trajectory = truth.trajectory_names[truth.trajectory[iid]]
    room = truth.room_names[truth.room[iid]] if truth.room[iid] >= 0 else "no room"
    parts = [f"#{iid} {room if store.has_poses else f'{trajectory} {truth.seq[iid]}'}"]
    if state.run == NO_RUN or not run_is_loaded(store, state.run):
        return parts[0]
    columns = store.run_columns(state.run)
    errors = {side: float(columns.side(side).error[iid]) for side in SIDES}
    parts += [
        f"{side} n/a" if math.isnan(error) else f"{side} {error:.2f} m"
        for side, error in errors.items()
    ]
    if not math.isnan(gap := errors["real"] - errors["sim"]):
        parts.append(f"gap {gap:+.2f} m")
    return ", ".join(parts)
